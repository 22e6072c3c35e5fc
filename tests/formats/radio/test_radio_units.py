"""Units: exact stamps, round trips of lengths and angles, dates."""

from __future__ import annotations

import math
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.formats.radio.radio_units import (
    METRES,
    NANOSECONDS,
    AzimuthZero,
    LengthUnit,
    TimeUnit,
    azimuth_rad,
    elevation_rad,
    metres,
    stamp_ns,
    stamp_unit_of,
)

EPOCH_NS = st.integers(10**18, 2 * 10**18)


@given(EPOCH_NS, st.sampled_from(["s", "ms", "us", "ns"]))
def test_every_unit_of_a_stamp_keeps_its_nanoseconds(ns: int, unit: TimeUnit) -> None:
    text = str(Decimal(ns) / NANOSECONDS[unit])
    assert stamp_ns(text, unit) == ns
    assert stamp_unit_of(Decimal(text)) == unit
    assert stamp_ns(text, "auto") == ns


@given(EPOCH_NS, st.sampled_from(["s", "ms", "us", "ns"]), st.sampled_from(["", " "]))
def test_a_unit_in_the_cell_counts(ns: int, unit: TimeUnit, space: str) -> None:
    assert stamp_ns(f"{Decimal(ns) / NANOSECONDS[unit]}{space}{unit}", "auto") == ns
    assert stamp_ns(f"{Decimal(ns) / NANOSECONDS[unit]}{space}{unit}", "us") == ns


@pytest.mark.parametrize("text", ["1.0 parsecs", "s", "1.0 s s", "1 2 s"])
def test_other_words_behind_a_number_are_no_unit(text: str) -> None:
    with pytest.raises(ValueError, match="is no time"):
        stamp_ns(text, "s")


@given(st.floats(0, 1e4), st.sampled_from(sorted(METRES)))
def test_lengths_come_back(length_m: float, unit: LengthUnit) -> None:
    assert metres(length_m / METRES[unit], unit) == pytest.approx(length_m, rel=1e-12, abs=1e-12)


def test_millimetres_are_exact_decimals() -> None:
    assert metres(20534, "mm") == 20.534


@given(st.floats(-math.pi, math.pi), st.booleans(), st.sampled_from(["forward", "left", "back", "right"]))
def test_azimuths_of_any_convention_point_the_same_way(true: float, clockwise: bool, zero: AzimuthZero) -> None:
    counted_from = {"forward": 0.0, "left": 90.0, "back": 180.0, "right": -90.0}[zero]
    stated_deg = math.degrees(true) - counted_from
    found = azimuth_rad(-stated_deg if clockwise else stated_deg, "deg", zero, clockwise=clockwise)
    assert math.cos(found - true) == pytest.approx(1.0, abs=1e-9)


def test_elevation_from_the_zenith() -> None:
    assert elevation_rad(80.0, "deg", "up") == pytest.approx(math.radians(10.0))


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("1970-01-01T00:00:01Z", 10**9),
        ("1970-01-01 00:00:01.123456789", 1_123_456_789),
        ("1970-01-01T01:00:00.5+01:00", 500_000_000),
        ("2022-11-28T14:13:42.19", 1_669_644_822_190_000_000),
    ],
)
def test_dates(text: str, ns: int) -> None:
    assert stamp_ns(text, "auto") == ns


@pytest.mark.parametrize("text", ["x", "", "nan", "inf", "2022-11-28", "1e99", "12:61:00", "1e9999999999"])
def test_what_is_no_time(text: str) -> None:
    with pytest.raises(ValueError, match=r"no time|a time of day|does not fit"):
        stamp_ns(text, "s")


@pytest.mark.parametrize(
    ("ticks", "unit"), [(133_444_736_000_000_001, "filetime"), (638_355_968_000_000_001, "dotnet")]
)  # 14 November 2023, 22:13:20, and a tick
def test_ticks_of_other_epochs_are_told_by_their_size(ticks: int, unit: TimeUnit) -> None:
    assert stamp_unit_of(Decimal(ticks)) == unit
    assert stamp_ns(str(ticks), "auto") == stamp_ns(ticks, unit) == 1_700_000_000 * 10**9 + 100
