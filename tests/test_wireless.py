from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.types import AoaPath, Heading, WirelessLog, WirelessMeasurement

STAMP_NS = 12_300_000_000
PATH = AoaPath(azimuth=0.31, sigma=0.1745, weight=0.62)
MEASURED = WirelessMeasurement(STAMP_NS, "alpha", "beta", range_m=23.41, range_sigma_m=0.5, paths=(PATH,))
COMPASS = Heading(STAMP_NS + 1_500_000_000, "gamma", 1.57, 0.05)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"azimuth": 45.0}, r"path azimuth is 45.0; it must lie within -2 pi and 2 pi \(radians\)"),
        ({"azimuth": float("nan")}, r"path azimuth is nan; it must be a finite number"),
        ({"azimuth": None}, r"path azimuth is None"),
        ({"elevation": 30.0}, r"path elevation is 30.0; it must lie within -pi/2 and pi/2"),
        ({"elevation": float("inf")}, r"path elevation is inf"),
        ({"sigma": 0.0}, r"path sigma is 0.0; it must be > 0"),
        ({"sigma": "0.1"}, r"path sigma is 0.1; it must be a finite number"),
        ({"weight": -0.1}, r"path weight is -0.1; it must be >= 0"),
        ({"weight": float("nan")}, r"path weight is nan"),
    ],
)
def test_paths_that_cannot_be(changed: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(PATH, **changed)


@given(azimuth=st.floats(-2 * np.pi, 2 * np.pi), elevation=st.none() | st.floats(-np.pi / 2, np.pi / 2))
def test_every_direction_is_a_path(azimuth: float, elevation: float | None) -> None:
    assert AoaPath(azimuth, 0.1, elevation=elevation).azimuth == azimuth


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"stamp_ns": 12.3}, r"stamp_ns of a wireless measurement is 12.3, a float; give integer nanoseconds"),
        ({"stamp_ns": np.float64(1.7e18)}, r"a float64; give integer nanoseconds"),
        ({"transmitter_stamp_ns": 12.3}, r"transmitter_stamp_ns of a measurement is 12.3"),
        ({"transmitter": "alpha"}, r"wireless measurement from 'alpha' to itself"),
        ({"range_m": -1.0}, r"range is -1.0; it must be a number >= 0"),
        ({"range_m": float("nan")}, r"range is nan"),
        ({"range_sigma_m": 0.0}, r"range_sigma is 0.0; it must be a number > 0"),
        ({"range_sigma_m": None}, r"range_sigma is None"),
        ({"range_m": None, "paths": ()}, r"without range and without paths"),
        ({"paths": (0.31,)}, r"paths of a wireless measurement: expected AoaPath, got a float"),
        ({"aoa_frame": "map"}, r"aoa_frame is 'map'; expected body, odometry or world"),
        ({"lever_arm_receiver": (0.0, 0.0)}, r"lever_arm_receiver is \(0.0, 0.0\); expected three finite numbers"),
    ],
)
def test_measurements_that_cannot_be(changed: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(MEASURED, **changed)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"stamp_ns": 12.3}, r"stamp_ns of a heading is 12.3"),
        ({"heading": float("nan")}, r"heading is nan"),
        ({"sigma": -1.0}, r"heading sigma is -1.0; it must be a number > 0"),
    ],
)
def test_headings_that_cannot_be(changed: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(COMPASS, **changed)  # type: ignore[arg-type]


def test_lists_and_numpy_stamps_are_converted() -> None:
    made = WirelessMeasurement(
        np.int64(STAMP_NS),  # type: ignore[arg-type]
        "alpha",
        "beta",
        range_m=23.41,
        range_sigma_m=0.5,
        paths=[PATH],  # type: ignore[arg-type]
        lever_arm_receiver=[0.0, 0.0, 0.0],  # type: ignore[arg-type]
    )
    assert made == MEASURED
    assert hash(made) == hash(MEASURED)
    assert type(made.stamp_ns) is int
    assert WirelessLog([MEASURED], [COMPASS]) == WirelessLog((MEASURED,), (COMPASS,))  # type: ignore[arg-type]


def test_a_log_holds_measurements_and_headings_only() -> None:
    with pytest.raises(InputError, match="measurements of a wireless log: expected WirelessMeasurement, got a Heading"):
        WirelessLog((COMPASS,))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="headings of a wireless log: expected Heading, got a WirelessMeasurement"):
        WirelessLog((), (MEASURED,))  # type: ignore[arg-type]


def test_each_shows_in_one_short_line() -> None:
    assert repr(PATH) == "AoaPath(0.310 rad, sigma 0.174, weight 0.62)"
    assert repr(replace(PATH, elevation=-0.5)) == "AoaPath(0.310 rad, elevation -0.500, sigma 0.174, weight 0.62)"
    assert repr(MEASURED) == "WirelessMeasurement('alpha' hears 'beta' at 12.300 s, 23.41 m, 1 path in body axes)"
    bearing = replace(MEASURED, range_m=None, range_sigma_m=None, paths=(PATH, PATH), aoa_frame="world")
    assert repr(bearing) == "WirelessMeasurement('alpha' hears 'beta' at 12.300 s, 2 paths in world axes)"
    assert repr(COMPASS) == "Heading('gamma' at 13.800 s, 1.570 rad, sigma 0.050)"
    log = WirelessLog((MEASURED,), (COMPASS,))
    assert repr(log) == "WirelessLog(1 measurement, 1 heading, of alpha, beta, gamma, 1.5 s)"
    assert repr(WirelessLog()) == "WirelessLog(empty)"


@pytest.mark.parametrize("sigma", [1e-9, 1e7, 4e225])
def test_sigmas_of_angles_have_a_range(sigma):
    with pytest.raises(InputError, match="path sigma"):
        AoaPath(0.3, sigma)
    with pytest.raises(InputError, match="heading sigma"):
        Heading(0, "alpha", 0.3, sigma)
