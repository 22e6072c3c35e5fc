from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.timed_scans import TimedScans

POINTS = np.random.default_rng(0).normal(0, 20, (1000, 3))
TIMES = np.linspace(0, 0.1, 1000)


def test_far_points_are_left_out_with_their_times_and_said_once(caplog: pytest.LogCaptureFixture) -> None:
    scans, points = TimedScans("a.bag"), POINTS.copy()
    points[[3, 500]] = [[1e30, 0, 0], [0, -2e6, 0]]
    for _ in range(3):
        scan = scans(0, points, TIMES, np.arange(1000))
        np.testing.assert_array_equal(scan.points, np.delete(POINTS, [3, 500], axis=0))
        np.testing.assert_allclose(scan.times, np.delete(TIMES, [3, 500]))
        assert scan.intensity is not None
        assert 500 not in scan.intensity
    assert caplog.text.count("a.bag: 2 of 1000 points of a scan lie beyond 1000 km") == 1


def test_many_far_points_are_another_thing_than_points() -> None:
    points = POINTS.copy()
    points[:60] *= 1e6
    with pytest.raises(InputError, match="points of a scan lie beyond 1000 km: it is damaged"):
        TimedScans()(0, points, None)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint64, np.int64])
def test_times_that_are_none_cost_their_points_alone(dtype: type) -> None:
    raw = (TIMES * 1e9).astype(dtype) if np.dtype(dtype).kind != "f" else TIMES.astype(dtype)
    raw[10] = np.finfo(dtype).max if np.dtype(dtype).kind == "f" else np.iinfo(dtype).max
    if np.dtype(dtype).kind == "f":
        raw[20] = np.nan
    scan = TimedScans()(10**18, POINTS, raw)
    assert scan.times is not None
    assert len(scan.points) == 1000 - (2 if np.dtype(dtype).kind == "f" else 1)
    assert np.ptp(scan.times) == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, *(f"{s}{b}" for s in "iu" for b in (1, 2, 4, 8))])
def test_any_bytes_as_times_never_warn(dtype: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        raw = rng.integers(0, 256, 1000 * np.dtype(dtype).itemsize, np.uint8).view(dtype)
        scan = TimedScans()(int(rng.integers(0, 7 * 10**18)), POINTS, raw)
        assert scan.times is None or np.isfinite(scan.times).all()
