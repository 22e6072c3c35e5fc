"""Whether odometry holds: voxels that a scan occupies, and KISS-ICP that is found again after an unforeseen turn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.frontends.config import KeyframeSettings, OdometrySettings
from wiclosure.frontends.front_end import OdometryRun
from wiclosure.frontends.odometry.hold import Occupied
from wiclosure.frontends.odometry.kiss_odometry import KissOdometry
from wiclosure.interfaces import Hold
from wiclosure.types import FloatArray, Scan


def room(seed: int = 0) -> FloatArray:
    """Walls, a floor, and pillars that tell its ends apart."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-15, -9, -1], [15, 9, 4], (12000, 3))
    side = rng.integers(0, 5, len(points))
    for face, (axis, value) in enumerate(((0, -15), (0, 15), (1, -9), (1, 9), (2, -1))):
        points[side == face, axis] = value
    pillars = rng.uniform([-12, -7], [12, 7], (12, 2))[rng.integers(0, 12, 3000)] + rng.uniform(-0.4, 0.4, (3000, 2))
    return np.concatenate([points, np.column_stack([pillars, rng.uniform(-1, 2, 3000)])])


def seen(world: FloatArray, T_world_body: FloatArray, stamp_ns: int, seed: int) -> Scan:
    """Two of three points, with noise, from a pose."""
    rng = np.random.default_rng(seed)
    some = world[rng.random(len(world)) < 0.67] + rng.normal(0.0, 0.01, 3)
    return Scan(stamp_ns, se3.transform(se3.inverse(T_world_body), some))


def follow(
    odometry: KissOdometry, poses: FloatArray, world: FloatArray, interval_ns: int = 10**8
) -> tuple[list[Hold], FloatArray]:
    """Holds and poses `T_odom_body` of the scans along a path."""
    holds, found = [], []
    for k, pose in enumerate(poses):
        found.append(odometry.register(seen(world, pose, k * interval_ns, k))[1])
        holds.append(odometry.hold)
    return holds, np.array(found)


def straight(count: int) -> FloatArray:
    return se3.from_yaw(np.zeros(count), np.linspace(0.0, 0.1 * (count - 1), count)[:, None] * [1.0, 0.2, 0.0])


def test_known_voxels() -> None:
    occupied = Occupied.by(np.array([[0.1, 0.1, 0.1], [-0.1, 3.2, 0.0]]), 0.5)
    asked = np.array([[0.4, 0.4, 0.4], [-0.4, 3.4, 0.4], [0.6, 0.1, 0.1], [0.1, -0.1, 0.1]])
    assert occupied.holds(asked).tolist() == [True, True, False, False]
    assert not len(occupied.holds(np.zeros((0, 3))))
    assert not Occupied.by(np.zeros((0, 3)), 0.5).holds(np.zeros((1, 3))).any()


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2.0))
def test_a_cloud_fits_itself_and_nothing_far_away(seed: int, voxel_m: float) -> None:
    points = np.random.default_rng(seed).uniform(-50, 50, (200, 3))
    occupied = Occupied.by(points, voxel_m)
    assert occupied.holds(points).all()
    assert not occupied.holds(points + 200.0).any()


@pytest.mark.parametrize("turn_deg", [-150, -40, 30, 90])
def test_after_an_unforeseen_turn_it_is_found_again(turn_deg: float) -> None:
    poses = straight(12)
    poses[8:] = poses[8:] @ se3.from_yaw(np.radians([turn_deg]), np.array([[0.5, -0.3, 0.0]]))
    holds, found = follow(KissOdometry(OdometrySettings(voxel_size_m=0.5)), poses, room())
    assert holds[8] is Hold.FOUND_AGAIN
    assert {*holds[:8]} == {Hold.HELD}
    assert Hold.LOST not in holds
    off = se3.between(se3.between(poses[:1], poses), found)
    assert np.linalg.norm(off[:, :3, 3], axis=1).max() < 0.1
    assert np.degrees(se3.rotation_angle(off).max()) < 1.0


@pytest.mark.parametrize("step", [2.0, 4.0, -4.0])
def test_a_first_step_that_nothing_foretold_is_found(step: float) -> None:
    poses = se3.from_yaw(np.zeros(4), np.arange(4)[:, None] * [step, 0.3, 0.0] - [step, 0.0, 0.0])
    _, found = follow(KissOdometry(OdometrySettings(voxel_size_m=0.5)), poses, room(), 10**9)  # a scan a second
    off = se3.between(se3.between(poses[:1], poses), found)
    assert np.linalg.norm(off[:, :3, 3], axis=1).max() < 0.2


def test_a_scan_of_elsewhere_is_lost_and_its_step_counts_as_unknown() -> None:
    run, inside = OdometryRun(OdometrySettings(voxel_size_m=0.5), [KeyframeSettings()], "alpha"), room()[::3]
    elsewhere = np.random.default_rng(9).uniform(-15, 15, inside.shape)
    for k, pose in enumerate(straight(12)):
        run.process(seen(elsewhere if k == 8 else inside, pose, k * 10**8, k))
    (result,) = run.results()
    assert 8 in result.lost
    assert not {*range(8)} & {*result.lost, *result.found_again}


@pytest.mark.parametrize("first", [0, 10])
def test_two_scans_in_three_seconds_are_enough_on_a_recorded_street(kitti_drive, first) -> None:
    rows = np.arange(first, len(kitti_drive), 15)
    odometry = KissOdometry()
    found = np.array([odometry.register(kitti_drive[row])[1] for row in rows[:5]])
    steps, true = (se3.between(of[:-1], of[1:]) for of in (found, kitti_drive.poses[rows[:5]]))
    assert np.linalg.norm((steps - true)[:, :3, 3], axis=1).max() < 0.8  # its truth is that good


def test_a_recorded_turn_that_kiss_icp_alone_does_not_follow(indoor_loop) -> None:
    odometry, rows = KissOdometry(), range(50, 76)
    found = np.array([odometry.register(indoor_loop[row])[1] for row in rows])
    off = se3.between(se3.between(indoor_loop.poses[50:51], indoor_loop.poses[50:76]), found)
    assert np.linalg.norm(off[:, :3, 3], axis=1).max() < 0.2
