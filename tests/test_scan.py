from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.types import Scan

POINTS = np.arange(12.0).reshape(4, 3)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"stamp_ns": 1.5}, r"stamp_ns of a scan is 1.5, a float; give integer nanoseconds"),
        ({"points": POINTS[:, :2]}, r"points of a scan have shape \(4, 2\); expected \(N, 3\)"),
        ({"points": POINTS.ravel()}, r"points of a scan have shape \(12,\)"),
        ({"points": [[1.0, 2.0, 3.0], [1.0]]}, r"points of a scan: expected an array of numbers, got a list"),
        ({"points": np.full((4, 3), np.nan)}, r"points of a scan are not all finite"),
        ({"times": np.zeros(3)}, r"times of a scan have shape \(3,\); expected \(4,\)"),
        ({"times": np.array([0, 1, 2, np.inf])}, r"times of a scan are not all finite"),
        ({"intensity": np.zeros(5)}, r"intensity of a scan have shape \(5,\)"),
    ],
)
def test_what_is_no_scan(fields: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Scan(**({"stamp_ns": 5, "points": POINTS} | fields))  # type: ignore[arg-type]


def test_lists_and_other_numbers_are_converted_and_float64_is_taken_as_it_is() -> None:
    made = Scan(np.int64(5), POINTS.astype(np.float32), [0, 1, 2, 3], np.arange(4))  # type: ignore[arg-type]
    assert type(made.stamp_ns) is int
    assert made.points.dtype == np.float64
    assert made.times is not None
    assert made.intensity is not None
    assert (made.times.dtype, made.intensity.dtype) == (np.float64, np.float32)
    assert Scan(5, POINTS).points is POINTS
    assert len(Scan(0, np.zeros((0, 3))).points) == 0


def test_a_scan_shows_in_one_short_line() -> None:
    assert repr(Scan(1_500_000_000, POINTS)) == "Scan(1.500 s, 4 points)"
    assert repr(Scan(1_500_000_000, POINTS, np.linspace(-0.05, 0.05, 4))) == "Scan(1.500 s, 4 points, sweep of 100 ms)"
