from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.formats.radio.wireless_log import DEFAULT_RANGE_SIGMA_M
from wiclosure.pipeline.radio.readers.account import (
    ANCHOR,
    EMPTY,
    FAR,
    INVALID,
    LIMITS,
    REPEATED,
    SAME,
    UNKNOWN,
    UNREADABLE,
    Account,
)  # fmt: skip
from wiclosure.pipeline.radio.readers.interpret import interpret
from wiclosure.pipeline.radio.readers.rows import ReceivedAt, Row
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.types import WirelessLog, WirelessMeasurement

ROW = {"stamp": "1700000000.5", "from": "7", "to": "12", "range": "3.25"}
ROBOTS = {7: "alpha", 12: "beta"}


def read(*rows: dict, known: tuple[str, ...] | None = ("alpha", "beta"), **settings) -> tuple[WirelessLog, Account]:
    source = RadioSource.model_validate({"path": "uwb.csv", "robots": ROBOTS, **settings})
    return interpret([Row(f"line {n}", values) for n, values in enumerate(rows, 1)], source, known, "uwb.csv")


def one(values: dict, **settings) -> WirelessMeasurement:
    (found,) = read({**ROW, **values}, **settings)[0].measurements
    return found


def test_a_plain_row() -> None:
    found = one({})
    assert (found.receiver, found.transmitter, found.range_m, found.range_sigma_m) == (
        "alpha", "beta", 3.25, DEFAULT_RANGE_SIGMA_M
    )  # fmt: skip
    assert found.stamp_ns == 1_700_000_000_500_000_000


@pytest.mark.parametrize(
    ("values", "settings", "expected"),
    [
        ({"range": "3250"}, {"unit": "mm"}, (3.25, None)),
        ({"range": 10}, {"unit": "ft"}, (3.048, None)),
        ({}, {"range_offset": -0.25}, (3.0, None)),
        ({}, {"range_offset": -5.0}, (0.0, None)),
        ({"range_sigma": "20"}, {"unit": "cm"}, (0.0325, 0.2)),
        ({"range_variance": 0.04}, {}, (3.25, 0.2)),
        ({"range_sigma": ""}, {}, (3.25, DEFAULT_RANGE_SIGMA_M)),
        ({"range_sigma": "9"}, {"range_sigma": 0.4}, (3.25, 0.4)),
    ],
)
def test_units_offsets_and_sigmas(values: dict, settings: dict, expected: tuple[float, float | None]) -> None:
    found = one(values, **settings)
    assert found.range_m == pytest.approx(expected[0])
    if expected[1] is not None:
        assert found.range_sigma_m == pytest.approx(expected[1])


@pytest.mark.parametrize(
    ("stamp", "settings", "ns"),
    [
        (ReceivedAt(5), {}, 5),
        (ReceivedAt(5), {"time_offset": -1.5}, 5 - 1_500_000_000),
        (("1700000000", "123456789"), {}, 1_700_000_000_123_456_789),
        ("1700000000123", {}, 1_700_000_000_123_000_000),  # milliseconds by their size
        ("12.5", {"stamp_unit": "ms"}, 12_500_000),
        ("1700000000.000000001", {"time_offset": 0.1}, 1_700_000_000_100_000_001),
        ("2023-11-14T22:13:20Z", {}, 1_700_000_000_000_000_000),
    ],
)
def test_times(stamp: object, settings: dict, ns: int) -> None:
    assert one({"stamp": stamp}, **settings).stamp_ns == ns


@given(azimuth=st.floats(-179.0, 179.0), elevation=st.floats(-80.0, 80.0))
def test_bearings_of_a_compass_are_turned_over(azimuth: float, elevation: float) -> None:
    row = {"range": "", "azimuth": azimuth, "elevation": elevation}
    (path,) = one(row, angle_unit="deg", clockwise=True, azimuth_zero="left").paths
    expected = math.radians(90.0 - azimuth)
    assert math.isclose(math.cos(path.azimuth - expected), 1.0, abs_tol=1e-12)
    assert path.elevation == pytest.approx(math.radians(elevation))


def test_a_position_is_a_range_and_a_bearing() -> None:
    found = one({"range": None, "x": 3.0, "y": -4.0, "z": 12.0})
    (path,) = found.paths
    assert found.range_m == pytest.approx(13.0)
    assert path.azimuth == pytest.approx(math.atan2(-4.0, 3.0))
    assert path.elevation == pytest.approx(math.atan2(12.0, 5.0))
    assert one({"range": None, "x": 3.0, "y": 4.0}, take="range").paths == ()
    assert one({"range": None, "x": 3.0, "y": 4.0}, take="bearing").range_m is None


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"valid": "False"}, INVALID),
        ({"valid": 0}, INVALID),
        ({"range": "-1"}, EMPTY),
        ({"range": "nan"}, EMPTY),
        ({"range": None}, EMPTY),
        ({"range": "99999"}, FAR),
        ({"range": "0.5", "range_low": "1"}, LIMITS),
        ({"range_high": 3.0}, LIMITS),
        ({"to": "7"}, SAME),
        ({"to": "101"}, ANCHOR),
        ({"to": "55"}, UNKNOWN),
        ({"range": "far"}, UNREADABLE),
        ({"stamp": ""}, UNREADABLE),
        ({"to": ""}, UNREADABLE),
        ({"range_sigma": -0.1}, UNREADABLE),
    ],
)
def test_what_is_left_out_is_counted_under_its_reason(values: dict, reason: str) -> None:
    good = [{**ROW, "range": str(1.0 + n)} for n in range(3)]
    log, account = read(*good, {**ROW, **values}, anchors=[101])
    assert len(log.measurements) == account.used == 3
    assert dict(account.left_out) == {reason: 1}
    assert account.first[reason].startswith("line 4")


def test_a_repetition_is_kept_once_and_measurements_are_in_order_of_time() -> None:
    log, account = read({**ROW, "stamp": "1700000009"}, ROW, ROW)
    assert [m.stamp_ns for m in log.measurements] == sorted(m.stamp_ns for m in log.measurements)
    assert account.first[REPEATED] == "line 3: as line 2"


@pytest.mark.parametrize(
    ("rows", "settings", "says"),
    [
        (
            [ROW, {**ROW, "range": "x"}],
            {},
            r"1 of 2 rows cannot be read \(line 2: range is 'x'.*which field means what",
        ),
        (
            [{**ROW, "range": "3000"}],
            {},
            "lie beyond 1000 m .*if they are millimetres or centimetres add unit: mm or unit: cm",
        ),
        ([{**ROW, "azimuth": "90"}], {}, "they look like degrees: add angle_unit: deg"),
        ([ROW], {"receiver": "gamma"}, "names the robot 'gamma', but there are alpha, beta"),
        ([ROW], {"robots": {7: "gamma"}}, "names the robot 'gamma'"),
    ],
)
def test_a_mapping_that_cannot_be_meant_is_refused(rows: list[dict], settings: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        read(*rows, **settings)


def test_antennas_belong_to_their_tags() -> None:
    found = one({}, lever_arms={"12": [0.1, 0.2, 0.3]})
    assert found.lever_arm_receiver == (0.0, 0.0, 0.0)
    assert found.lever_arm_transmitter == (0.1, 0.2, 0.3)
