"""What only recorded odometry does; what it shares with the others is tested in test_odometry.py."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.odometry.recorded_odometry import RecordedOdometry
from wiclosure.types import Scan, Trajectory

SPEED = np.array([0.0, 0.0, 0.5, 4.0, 0.0, 0.0])  # rad/s about z, m/s ahead
SETTINGS = OdometrySettings(min_range_m=0.5, max_range_m=100.0, voxel_size_m=1.0)


def at(seconds: np.ndarray) -> np.ndarray:
    return se3.exp(np.atleast_1d(seconds)[:, None] * SPEED)


def recorded(rate_hz: float, seconds: float = 4.0) -> Trajectory:
    stamps_s = np.arange(0.0, seconds, 1 / rate_hz)
    return Trajectory("alpha", np.rint(stamps_s * 1e9).astype(np.int64), at(stamps_s))


@pytest.mark.parametrize("rate_hz", [100.0, 10.0])
def test_points_seen_from_many_places_come_to_where_they_are_at_the_end(rate_hz: float) -> None:
    rng = np.random.default_rng(0)
    world, times = rng.uniform(-30, 30, (500, 3)), np.linspace(0.0, 0.1, 500)
    seen = se3.transform(se3.inverse(at(1.0 + times)), world)
    stamp_ns, T_odom_body, points = RecordedOdometry(SETTINGS, recorded(rate_hz)).register(
        Scan(1_000_000_000, seen, times)
    )
    assert stamp_ns == 1_100_000_000
    np.testing.assert_allclose(T_odom_body, at(1.1)[0], atol=1e-9)
    assert len(points) == 500
    # The library's deskewing is exact for motion along one screw, to the pieces that the sweep is cut in.
    np.testing.assert_allclose(se3.transform(T_odom_body, points), world, atol=0.02)


def test_points_stay_as_they_are_where_deskewing_is_off() -> None:
    points, times = np.random.default_rng(1).uniform(1, 30, (50, 3)), np.linspace(0.0, 0.1, 50)
    settings = SETTINGS.model_copy(update={"deskew": False})
    stamp_ns, _, found = RecordedOdometry(settings, recorded(100.0)).register(Scan(10**9, points, times))
    assert stamp_ns == 10**9
    np.testing.assert_array_equal(found, points)


def test_sparse_odometry_reaches_half_a_second_at_most() -> None:
    stamps_ns = np.arange(3) * 10 * 10**9
    sparse = RecordedOdometry(SETTINGS, Trajectory("alpha", stamps_ns, at(stamps_ns * 1e-9)))
    last_ns = int(stamps_ns[-1])
    assert sparse.covers(Scan(last_ns + 500_000_000, np.ones((1, 3))))
    assert not sparse.covers(Scan(last_ns + 500_000_001, np.ones((1, 3))))
