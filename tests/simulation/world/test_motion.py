"""Drives: within the limits of the drive, on the ground, through the waypoints, standing where they should."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.errors import ConfigError
from wiclosure.simulation.world.ground import Ground, rough_ground
from wiclosure.simulation.world.motion import START_NS, MotionSettings, PathMotion, Stop, drive

LIMITS = MotionSettings(speed_mps=2.0, acceleration_mps2=0.7, lateral_mps2=0.9, turn_rate_rps=0.8, corner_m=2.0)
FLAT = Ground(np.linspace(-100, 100, 5), np.linspace(-100, 100, 5), np.zeros((5, 5)))
ROUND_THE_CORNER = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 15.0], [-5.0, 18.0]])


def sampled(motion: PathMotion, step_ns: int = 10_000_000) -> tuple[np.ndarray, np.ndarray]:
    stamps = START_NS + np.arange(0, motion.duration_ns, step_ns, dtype=np.int64)
    return stamps, motion.T_world_body(stamps)


@given(
    st.lists(st.tuples(st.floats(8.0, 25.0), st.floats(-1.9, 1.9)), min_size=1, max_size=6),
    st.floats(0.3, 10.0),
    st.floats(0.3, 3.0),
)
@settings(max_examples=30, deadline=None)
def test_speed_acceleration_and_turns_stay_within_limits(
    legs: list[tuple[float, float]], speed_mps: float, lateral_mps2: float
) -> None:
    heading = np.cumsum([turn for _, turn in legs])
    steps = np.array([length for length, _ in legs])[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    limits = LIMITS.model_copy(update={"speed_mps": speed_mps, "lateral_mps2": lateral_mps2, "sway_deg": 0.0})
    motion = drive(np.vstack([[0, 0], np.cumsum(steps, axis=0)]), FLAT, limits)
    stamps, poses = sampled(motion)
    distance = motion.distance(stamps)
    speed = np.diff(distance) / 0.01
    assert (speed >= -1e-6).all()
    assert speed.max() <= speed_mps + 1e-6
    assert np.abs(np.diff(speed)).max() / 0.01 <= limits.acceleration_mps2 * 1.01 + 1e-6
    turn_rate = np.abs(np.diff(np.unwrap(se3.yaw(poses)))) / 0.01
    assert turn_rate.max() <= limits.turn_rate_rps * 1.05
    assert (turn_rate * speed).max() <= lateral_mps2 * 1.05


def test_starts_and_ends_at_the_waypoints_and_rounds_the_corners() -> None:
    motion = drive(ROUND_THE_CORNER, FLAT, LIMITS)
    poses = motion.T_world_body(np.array([START_NS - 10**9, START_NS, START_NS + motion.duration_ns + 10**9]))
    np.testing.assert_allclose(poses[[0, 1], :2, 3], [[0, 0], [0, 0]], atol=1e-3)
    np.testing.assert_allclose(poses[2, :2, 3], [-5, 18], atol=1e-2)
    _, path = sampled(motion)
    assert 0.1 < np.linalg.norm(path[:, :2, 3] - [20, 0], axis=1).min() < LIMITS.corner_m


def test_stands_still_where_asked() -> None:
    motion = drive(ROUND_THE_CORNER, FLAT, LIMITS, (Stop(10.0, 4.0),), start_s=2.0)
    stamps, poses = sampled(motion)
    still = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1) < 1e-9
    assert still.sum() * 0.01 == pytest.approx(6.0, abs=0.05)
    assert np.allclose(poses[:-1][still], poses[1:][still])
    assert motion.distance(stamps)[np.flatnonzero(still)[-1]] == pytest.approx(10.0, abs=0.05)


def test_follows_rough_ground_upright_to_it() -> None:
    ground = rough_ground(np.random.default_rng(3), (-20.0, -20.0), (40.0, 40.0), roughness_m=0.5)
    motion = drive(ROUND_THE_CORNER, ground, LIMITS.model_copy(update={"sway_deg": 0.0}))
    _, poses = sampled(motion)
    foot = poses[:, :3, 3] - LIMITS.sensor_height_m * poses[:, :3, 2]
    np.testing.assert_allclose(foot[:, 2], ground.height(foot[:, :2]), atol=1e-3)
    np.testing.assert_allclose(poses[:, :3, 2], ground.normal(foot[:, :2]), atol=1e-3)
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0)
    assert np.abs(np.diff(foot[:, 2])).max() > 1e-4


def test_sway_is_as_strong_as_asked_for() -> None:
    motion = drive(np.array([[0.0, 0.0], [90.0, 0.0]]), FLAT, LIMITS.model_copy(update={"sway_deg": 1.5}))
    _, poses = sampled(motion)
    tilt_deg = np.rad2deg(np.arccos(np.clip(poses[:, 2, 2], -1, 1)))
    assert np.sqrt((tilt_deg**2).mean()) == pytest.approx(1.5 * np.sqrt(2), rel=0.25)


def test_ground_between_grid_points_matches_what_rays_hit() -> None:
    from wiclosure.simulation.world.scene import SceneBuilder

    ground = rough_ground(np.random.default_rng(0), (-30.0, -30.0), (30.0, 30.0), roughness_m=0.4)
    assert ground.height_m.std() == pytest.approx(0.4, rel=0.4)
    xy = np.random.default_rng(1).uniform(-25, 25, (500, 2))
    rays = np.column_stack([xy, np.full(500, 20.0), np.zeros((500, 2)), np.full(500, -1.0)]).astype(np.float32)
    hit = SceneBuilder(ground).build().cast(rays)
    assert np.abs(20.0 - hit.distance_m - ground.height(xy)).max() < 0.05


@pytest.mark.parametrize(
    ("waypoints", "stops", "message"),
    [
        ([[0, 0]], (), "at least two waypoints"),
        ([[0, 0], [0, 0], [5, 5]], (), "at least two waypoints"),
        ([[0, 0], [20, 0], [0, 0.01]], (), "turns back on itself near"),
        ([[0, 0], [20, 0]], (Stop(50.0, 1.0),), "outside the path"),
        ([[0, 0], [20, 0]], (Stop(10.0, 1.0), Stop(10.2, 1.0)), "less than 0.5 m apart"),
    ],
)
def test_paths_that_cannot_be_driven_are_refused(
    waypoints: list[list[float]], stops: tuple[Stop, ...], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        drive(np.array(waypoints, float), FLAT, LIMITS, stops)
