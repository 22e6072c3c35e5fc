from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from wiclosure import se3
from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.odometry.kiss_odometry import KissOdometry
from wiclosure.frontends.odometry.sweep import within_range
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.types import FloatArray, Scan

PERIOD_S = 0.1
SPEED = np.array([0.0, 0.0, 0.4, 3.0, 0.5, 0.0])  # rad/s about x y z, m/s along x y z


def wall_points(seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    points = rng.uniform([-15, -10, -1], [15, 10, 4], (9000, 3))
    side = rng.integers(0, 5, len(points))
    for face, (axis, value) in enumerate(((0, -15), (0, 15), (1, -10), (1, 10), (2, -1))):
        points[side == face, axis] = value
    boxes = rng.uniform([-12, -8], [12, 8], (12, 2))[rng.integers(0, 12, 2500)] + rng.uniform(-0.4, 0.4, (2500, 2))
    return np.concatenate([points, np.column_stack([boxes, rng.uniform(-1, 2, 2500)])])


def sweep(start_s: float, times: FloatArray, points_world: FloatArray) -> FloatArray:
    """Points as a sensor sees them that moves at constant speed, each at its own time."""
    T_world_body = se3.exp((start_s + times)[:, None] * SPEED)
    return se3.transform(se3.inverse(T_world_body), points_world)


@pytest.mark.parametrize(("first_time_s", "interval_s"), [(0.0, 0.1), (-0.1, 0.1), (-0.05, 0.1), (0.0, 0.2)])
def test_the_pose_and_the_deskewed_points_belong_to_the_last_point(first_time_s: float, interval_s: float) -> None:
    """Also in a recording of which every other scan was dropped."""
    world = wall_points()
    odometry = KissOdometry(OdometrySettings(voxel_size_m=0.5))
    times = np.random.default_rng(1).permutation(np.linspace(first_time_s, first_time_s + PERIOD_S, len(world)))
    errors = []
    for k in range(12):
        stamp_ns = round(k * interval_s * 1e9)
        scan = Scan(stamp_ns, sweep(k * interval_s, times, world), times)
        pose_ns, _, points = odometry.register(scan)
        assert pose_ns == stamp_ns + round(times.max() * 1e9)
        T_world_body = se3.exp(pose_ns * 1e-9 * SPEED)
        # Range cropping may drop points, none here: rows stay in order.
        errors.append(np.median(np.linalg.norm(se3.transform(T_world_body, points) - world, axis=1)))
    assert errors[-1] < 0.02
    assert errors[-1] < 0.2 * np.median(
        np.linalg.norm(se3.transform(se3.exp(pose_ns * 1e-9 * SPEED), scan.points) - world, axis=1)
    )


def test_without_times_the_pose_belongs_to_the_stamp() -> None:
    odometry = KissOdometry()
    stamp_ns, T_odom_body, points = odometry.register(Scan(1_700_000_000_123_456_789, wall_points()))
    assert stamp_ns == 1_700_000_000_123_456_789
    np.testing.assert_array_equal(T_odom_body, np.eye(4))
    assert len(points) == len(wall_points())


def test_times_that_are_all_alike_do_not_deskew() -> None:
    odometry = KissOdometry()
    same = np.full(len(wall_points()), 0.05)
    assert odometry.register(Scan(0, wall_points(), same))[0] == 0


def test_points_beyond_the_ranges_are_not_used() -> None:
    settings = OdometrySettings(min_range_m=5.0, max_range_m=12.0)
    odometry = KissOdometry(settings)
    scan = Scan(0, wall_points())
    _, _, points = odometry.register(scan)
    distance = np.linalg.norm(points, axis=1)
    assert 5.0 < distance.min() < distance.max() < 12.0
    assert len(points) == np.count_nonzero(within_range(scan.points, settings))


def test_ranges_the_wrong_way_round_are_refused() -> None:
    with pytest.raises(ValidationError, match="no point would be left"):
        OdometrySettings(min_range_m=120.0)


@pytest.mark.parametrize(("extent_m", "voxel_m"), [(40.0, 1.0), (200.0, 1.0), (20.0, 0.5), (8.0, 0.25), (1.0, 0.125)])
def test_voxels_follow_the_extent_of_the_surroundings(extent_m: float, voxel_m: float) -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (5000, 3))
    points *= extent_m / np.quantile(np.linalg.norm(points, axis=1), 0.95)
    assert voxel_size_m(points) == voxel_m


def test_another_goes_on_from_its_state_to_the_same_bit() -> None:
    world = wall_points()[::8]  # the search after the jolt takes long with more
    times = np.linspace(0.0, PERIOD_S, len(world))
    scans = [Scan(round(k * 1e8), sweep(k * 0.1, times, world), times) for k in range(14)]
    # A jolt half-way: whether odometry holds there, depends on what it remembers of the scans before.
    scans[9] = Scan(scans[9].stamp_ns, se3.transform(se3.exp(np.array([0, 0, 0.6, 0, 0, 0])), scans[9].points), times)
    whole, interrupted = (KissOdometry(OdometrySettings(voxel_size_m=0.5)) for _ in range(2))
    for number, scan in enumerate(scans):
        if number in {0, 1, 8, 9, 10}:
            state, interrupted = interrupted.state(), KissOdometry(OdometrySettings(voxel_size_m=0.5))
            interrupted.restore(state)
        one, other = whole.register(scan), interrupted.register(scan)
        assert one[0] == other[0]
        assert one[1].tobytes() == other[1].tobytes()
        assert one[2].tobytes() == other[2].tobytes()
        assert whole.hold is interrupted.hold
        assert whole.thinned.tobytes() == interrupted.thinned.tobytes()
