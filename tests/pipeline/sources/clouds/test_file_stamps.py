"""Stamps and order by file names: padded or not, seconds and fractions, dates, frame numbers."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.pipeline.sources.clouds.file_stamps import natural, stamps_of_names

SECOND = 10**9
START_S = 1_700_000_000
TENTHS = [(START_S * SECOND + k * SECOND // 10) for k in range(25)]


def stamps(names: list[str]) -> list[int]:
    return stamps_of_names(names).stamps_ns.tolist()


@pytest.mark.parametrize("prefix", ["", "cloud_", "lidar-top__", "a1_"])
@pytest.mark.parametrize("separator", ["_", "."])
@pytest.mark.parametrize("padded", [True, False])
def test_seconds_and_nanoseconds(prefix: str, separator: str, padded: bool) -> None:
    names = [f"{prefix}{ns // SECOND}{separator}{ns % SECOND:0{9 if padded else 1}d}" for ns in TENTHS]
    found = stamps_of_names(names)
    assert found.stamps_ns.tolist() == TENTHS
    assert not found.made_up


@pytest.mark.parametrize("separator", ["_", "."])
def test_nanoseconds_below_a_tenth_that_are_not_padded(separator: str) -> None:
    expected = [START_S * SECOND + 50_000_000 + k * 100_000_000 for k in range(20)]
    assert stamps([f"{ns // SECOND}{separator}{ns % SECOND}" for ns in expected]) == expected


def test_seconds_and_microseconds() -> None:
    expected = [START_S * SECOND + 50_000_000 + k * 100_000_000 for k in range(20)]
    assert stamps([f"{ns // SECOND}_{ns % SECOND // 1000}" for ns in expected]) == expected


def test_decimal_seconds() -> None:
    assert stamps([f"{START_S}.{k}" for k in range(10)]) == TENTHS[:10]
    assert stamps(["12.5", "12.25"]) == [12_500_000_000, 12_250_000_000]


@pytest.mark.parametrize("unit_ns", [1, 10**3, 10**6, 10**9])
@pytest.mark.parametrize("prefix", ["", "n015-2018-07-24__LIDAR_TOP__"])
def test_dates_in_any_unit(unit_ns: int, prefix: str) -> None:
    expected = [START_S * SECOND + k * SECOND for k in range(4)]
    assert stamps([f"{prefix}{ns // unit_ns}" for ns in expected]) == expected


@pytest.mark.parametrize("prefix", ["", "scan_"])
def test_ticks_since_1601_and_in_ten_microseconds(prefix: str) -> None:
    filetimes = [f"{prefix}{133_444_736_000_000_000 + k * 10**6}" for k in range(25)]
    assert stamps(filetimes) == TENTHS
    assert "filetime" in stamps_of_names(filetimes).how
    assert stamps([f"{prefix}{ns // 10**4}" for ns in TENTHS]) == TENTHS


@given(st.lists(st.integers(0, 99_999), min_size=1, max_size=50, unique=True), st.sampled_from(["", "scan_", "f-"]))
def test_frame_numbers_padded_or_not(numbers: list[int], prefix: str) -> None:
    for width in (1, 6):
        found = stamps_of_names([f"{prefix}{number:0{width}d}" for number in numbers])
        np.testing.assert_array_equal(found.stamps_ns, np.array(numbers) * SECOND // 10)
        assert found.made_up


def test_names_without_order_of_their_own() -> None:
    assert stamps(["scan_a", "scan_b", "other"]) == [0, 10**8, 2 * 10**8]
    assert stamps(["b_1_2", "b_2_1"]) == [0, 10**8]


@pytest.mark.parametrize("separator", [".", "_"])
@pytest.mark.parametrize("prefix", ["", "scan_"])
def test_whole_seconds_may_have_lost_their_fraction(separator: str, prefix: str) -> None:
    names = [f"{prefix}{START_S + k // 10}" + (f"{separator}{k % 10}" if k % 10 else "") for k in range(25)]
    assert (
        stamps(names if separator == "." else [n + "00000000" * (n.count("_") > prefix.count("_")) for n in names])
        == TENTHS
    )


def test_natural_order() -> None:
    names = ["s10.bin", "s9.bin", "s1.bin", "s010b.bin", "a.bin"]
    assert sorted(names, key=natural) == ["a.bin", "s1.bin", "s9.bin", "s010b.bin", "s10.bin"]


@pytest.mark.parametrize("padded", [True, False])
def test_seconds_and_milliseconds(padded: bool) -> None:
    expected = [START_S * SECOND + 50_000_000 + k * 100_000_000 for k in range(20)]
    names = [f"{ns // SECOND}_{ns % SECOND // 10**6:0{3 if padded else 1}d}" for ns in expected]
    assert stamps(names) == expected


@pytest.mark.parametrize(
    "form",
    ["%Y-%m-%d_%H-%M-%S", "scan_%Y%m%d_%H%M%S", "%Y%m%dT%H%M%S.000", "%Y-%m-%dT%H:%M:%S_cloud", "%Y_%m_%d-%H.%M.%S"],
)
def test_dates_with_their_time(form: str) -> None:
    times = [datetime(2023, 11, 14, 22, 13, 58, tzinfo=UTC) + timedelta(seconds=k) for k in range(5)]
    found = stamps_of_names([time.strftime(form) for time in times])
    assert found.stamps_ns.tolist() == [round(time.timestamp()) * SECOND for time in times]
    assert not found.made_up


def test_a_day_alone_is_no_time() -> None:
    found = stamps_of_names([f"20231114_{k}" for k in range(8, 12)])
    assert found.made_up
    assert np.diff(found.stamps_ns).tolist() == [SECOND // 10] * 3
