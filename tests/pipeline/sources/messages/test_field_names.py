from __future__ import annotations

import numpy as np
import pytest

from wiclosure.pipeline.sources.messages.field_names import (
    are_of_flight,
    intensity_field,
    like_times,
    plain,
    time_fields,
)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["x", "y", "z", "intensity", "t", "reflectivity", "ring", "ambient", "range"], ["t"]),  # Ouster
        (["x", "y", "z", "intensity", "ring", "time"], ["time"]),  # Velodyne
        (["x", "y", "z", "intensity", "timestamp", "ring"], ["timestamp"]),  # Hesai, RoboSense
        (["x", "y", "z", "offset_time", "line", "tag"], ["offset_time"]),  # Livox
        (["x", "y", "z", "Time_NS", "timestamp"], ["Time_NS", "timestamp"]),  # a unit is no matter
        (["x", "y", "z"], []),
        (["x", "y", "z", "runtime"], []),
    ],
)
def test_times_of_drivers(names: list[str], expected: list[str]) -> None:
    assert time_fields(names) == expected


@pytest.mark.parametrize(
    ("names", "expected"),
    [(["reflectivity", "intensity"], "intensity"), (["Reflectance"], "Reflectance"), (["I"], "I"), (["ring"], None)],
)
def test_intensity_of_drivers(names: list[str], expected: str | None) -> None:
    assert intensity_field(names) == expected


def test_names_are_compared_without_case_and_underscores() -> None:
    assert plain("Offset_Time [ns]") == "offsettimens"


def test_what_looks_like_a_time_and_is_none_is_told() -> None:
    assert like_times(["x", "laser_time_raw", "time", "host_stamp"], ["time"]) == ["laser_time_raw", "host_stamp"]


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint32])
def test_times_of_flight_are_told_from_times_of_points(dtype: type) -> None:
    points = np.random.default_rng(0).normal(0, 20, (500, 3)).astype(np.float32)
    flight_ps = (np.linalg.norm(points, axis=1) * 2 / 0.000299792458).astype(dtype)
    sweep_ns = np.linspace(0, 1e8, 500).astype(dtype)
    assert are_of_flight("tof", flight_ps, *points.T)
    assert not are_of_flight("tof", sweep_ns, *points.T)
    assert not are_of_flight("time", flight_ps, *points.T)
    assert not are_of_flight("tof", flight_ps[:5], *points[:5].T)
    assert not are_of_flight("tof", np.zeros(500, dtype), *points.T)
