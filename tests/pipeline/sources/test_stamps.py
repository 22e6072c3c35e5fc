"""Stamps that fail: strays, clocks that stand still or are set back, and what is left of the messages then."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.pipeline.sources.stamps import Stamped, mended

SECOND = 10**9
START_NS = 1_700_000_000 * SECOND
REGULAR = [START_NS + number * SECOND // 10 for number in range(12)]


def mend(headers: list[int], received: list[int] | None = None) -> list[tuple[int, int]]:
    messages = zip(headers, received or REGULAR, range(len(headers)), strict=False)
    return list(mended((Stamped(*message) for message in messages), "/points"))


@given(st.lists(st.integers(1, 10 * SECOND), min_size=1, max_size=12))
def test_stamps_that_increase_stay_as_they_are(steps: list[int]) -> None:
    headers = [START_NS + sum(steps[: number + 1]) for number in range(len(steps))]
    assert mend(headers) == list(zip(headers, range(len(headers)), strict=True))


@pytest.mark.parametrize("number", range(12))
@pytest.mark.parametrize("off_s", [3600, -3600])
def test_one_odd_stamp_loses_one_message(number: int, off_s: int, caplog: pytest.LogCaptureFixture) -> None:
    headers = [stamp + off_s * SECOND * (index == number) for index, stamp in enumerate(REGULAR)]
    kept = {index: stamp for stamp, index in mend(headers)}
    for index in set(range(12)) - {number}:
        assert kept[index] == REGULAR[index]
    assert kept.get(number, REGULAR[number]) == REGULAR[number]  # left out, or put right by the time of reception
    assert "/points" in caplog.text


@pytest.mark.parametrize("constant", [0, 5 * SECOND, START_NS + 7])
def test_stamps_that_stand_still_become_times_of_reception(constant: int) -> None:
    assert [stamp for stamp, _ in mend([constant] * 12)] == REGULAR


def test_missing_stamps_are_said_and_filled_in(caplog: pytest.LogCaptureFixture) -> None:
    assert [stamp for stamp, _ in mend([0 if k in {3, 4} else stamp for k, stamp in enumerate(REGULAR)])] == REGULAR
    assert "2 messages have no stamps; times of reception are used for them" in caplog.text


def test_stamps_that_stand_twice_each_are_filled_in(caplog: pytest.LogCaptureFixture) -> None:
    assert [stamp for stamp, _ in mend([REGULAR[k // 2 * 2] for k in range(12)])] == REGULAR
    assert "5 messages repeat the stamp before them; times of reception are used for them" in caplog.text


def test_a_clock_that_stops_goes_on_by_reception() -> None:
    headers = [stamp + 12_345 for stamp in REGULAR]
    headers[6:] = [headers[5]] * 6
    assert [stamp for stamp, _ in mend(headers)] == [stamp + 12_345 for stamp in REGULAR]


def test_a_clock_set_back_goes_on_by_reception(caplog: pytest.LogCaptureFixture) -> None:
    headers = REGULAR[:4] + [stamp - 100 * SECOND for stamp in REGULAR[4:]]
    assert [stamp for stamp, _ in mend(headers)] == REGULAR
    assert "go back from message 4 on" in caplog.text


def test_a_clock_set_forward_is_said(caplog: pytest.LogCaptureFixture) -> None:
    headers = [12 * SECOND + number * SECOND // 10 for number in range(6)] + REGULAR[6:]
    assert len(mend(headers)) == 12
    assert "leap" in caplog.text


def test_without_times_of_reception_what_goes_back_is_left_out() -> None:
    headers = REGULAR[:4] + [stamp - 100 * SECOND for stamp in REGULAR[4:]]
    kept = mend(headers, [START_NS] * 12)
    assert [stamp for stamp, _ in kept] == sorted({stamp for stamp, _ in kept})
    assert [index for _, index in kept][:4] == [0, 1, 2, 3]


def test_memory_holds_few_messages() -> None:
    taken = []

    def messages() -> object:
        for number in range(1000):
            taken.append(number)
            yield Stamped(START_NS + number, START_NS + number, number)

    for given_out, _ in enumerate(mended(messages(), "/points")):  # type: ignore[arg-type]
        assert len(taken) - given_out <= 5


def test_stamps_that_hardly_pass_are_said(caplog: pytest.LogCaptureFixture) -> None:
    headers = [START_NS + (stamp - START_NS) // 10**6 for stamp in REGULAR]
    assert len(mend(headers, REGULAR)) == 12
    assert "the stamps are in another unit or wrong" in caplog.text
    caplog.clear()
    mend(REGULAR, [START_NS + number for number in range(12)])  # a bag that was converted quickly
    assert "unit" not in caplog.text
