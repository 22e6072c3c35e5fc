"""Rays: distances to known walls, noise as asked for, and motion distortion that deskewing undoes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import ConfigError
from wiclosure.simulation.sensors.lidar import LIDARS, LidarModel, lidar_model, sweep
from wiclosure.simulation.world.ground import Ground
from wiclosure.simulation.world.mesh import box, cylinder
from wiclosure.simulation.world.motion import START_NS
from wiclosure.simulation.world.scene import Scene, SceneBuilder
from wiclosure.types import FloatArray, IntArray, Scan

PERFECT = replace(lidar_model("generic-32"), range_sigma_m=0.0, dropout=0.0, beam_sigma_deg=0.0, beam_sigma_m=0.0)


def flat(size_m: float = 60.0) -> Ground:
    axis = np.linspace(-size_m, size_m, 5)
    return Ground(axis, axis, np.zeros((5, 5)))


@pytest.fixture(scope="module")
def room() -> Scene:
    """Four walls: inner faces at x = 20, x = -10, y = 8, y = -8."""
    builder = SceneBuilder(flat())
    builder.stand(box(0.5, 40, 12), 20.25, 0)
    builder.stand(box(0.5, 40, 12), -10.25, 0)
    builder.stand(box(40, 0.5, 12), 5, 8.25)
    builder.stand(box(40, 0.5, 12), 5, -8.25)
    return builder.build()


def standing(x_m: float = 0.0, yaw_rad: float = 0.0) -> FloatArray:
    return se3.from_yaw(yaw_rad, np.array([x_m, 0.0, 1.5]))


def scan_of(model: LidarModel, scene: Scene, pose: FloatArray, seed: int = 0) -> Scan:
    rng, sensor = np.random.default_rng(seed), lambda stamps: np.broadcast_to(pose, (len(stamps), 4, 4))
    scan, moving = sweep(model.individual(rng), scene, sensor, START_NS, rng)
    assert not moving.any()
    return scan


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.5])
def test_points_lie_on_the_walls(room: Scene, yaw_rad: float) -> None:
    pose = standing(3.0, yaw_rad)
    points = se3.transform(pose, scan_of(PERFECT, room, pose).points)
    to_surface = np.min(
        np.abs(
            [points[:, 0] - 20, points[:, 0] + 10, points[:, 1] - 8, points[:, 1] + 8, points[:, 2]],
        ),
        axis=0,
    )
    assert len(points) > 0.8 * PERFECT.columns * 32
    assert to_surface.max() < 1e-3


def test_rays_run_clockwise_from_behind(room: Scene) -> None:
    scan = scan_of(PERFECT, room, standing())
    assert scan.times is not None
    azimuth = np.arctan2(scan.points[:, 1], scan.points[:, 0])
    expected = np.pi - 2 * np.pi * (scan.times / 0.1 + 0.5 / PERFECT.columns)
    assert np.abs(azimuth - expected).max() < 1e-4
    assert scan.times.min() >= 0
    assert scan.times.max() < 0.1


def test_range_noise_is_as_asked_for(room: Scene) -> None:
    noisy = replace(PERFECT, range_sigma_m=0.05)
    a, b = scan_of(PERFECT, room, standing()), scan_of(noisy, room, standing())
    error = np.linalg.norm(b.points, axis=1) - np.linalg.norm(a.points, axis=1)
    assert error.std() == pytest.approx(0.05, rel=0.05)
    assert abs(error.mean()) < 0.002


def test_drop_out_and_range_cut(room: Scene) -> None:
    all_points = scan_of(PERFECT, room, standing()).points
    some = scan_of(replace(PERFECT, dropout=0.3), room, standing()).points
    assert len(some) / len(all_points) == pytest.approx(0.7, abs=0.02)
    near = scan_of(replace(PERFECT, min_range_m=2.0, max_range_m=7.0), room, standing()).points
    distance = np.linalg.norm(near, axis=1)
    assert distance.min() >= 2.0
    assert distance.max() <= 7.0


def test_calibration_errors_stay_from_scan_to_scan(room: Scene) -> None:
    crooked = replace(PERFECT, beam_sigma_m=0.1)
    rng = np.random.default_rng(0)
    sensor = crooked.individual(rng)
    pose = standing()
    scans = [
        sweep(sensor, room, lambda stamps: np.broadcast_to(pose, (len(stamps), 4, 4)), START_NS, rng)[0] for _ in (0, 1)
    ]
    np.testing.assert_allclose(scans[0].points, scans[1].points, atol=1e-5)
    assert np.abs(scans[0].points - scan_of(PERFECT, room, pose).points).max() > 0.05


def test_beams_that_look_higher_than_they_say_bend_the_ground_until_raised(room: Scene) -> None:
    error_deg = 0.5
    seen = scan_of(replace(PERFECT, elevation_error_deg=error_deg), room, standing()).points
    ground = np.linalg.norm(seen[:, :2], axis=1) < 7.5
    assert np.abs(seen[ground, 2] + 1.5).max() > 0.05
    range_m = np.linalg.norm(seen, axis=1)
    azimuth, elevation = np.arctan2(seen[:, 1], seen[:, 0]), np.arcsin(seen[:, 2] / range_m)
    raised = elevation + np.radians(error_deg)
    directions = np.stack([np.cos(azimuth) * np.cos(raised), np.sin(azimuth) * np.cos(raised), np.sin(raised)], axis=1)
    points = range_m[:, None] * directions
    assert np.abs(points[ground, 2] + 1.5).max() < 1e-3


def test_far_ground_at_a_flat_angle_is_not_seen_but_a_wall_there_is() -> None:
    builder = SceneBuilder(flat(200.0))
    builder.stand(box(1, 30, 8), 61, 0)
    points = scan_of(replace(PERFECT, elevations_deg=(-1.0, 1.0)), builder.build(), standing()).points
    assert np.abs(points[:, 0] - 60.5).max() < 0.1


def test_deskewing_with_the_true_motion_flattens_the_walls(room: Scene) -> None:
    """8 m/s and a turn of 1 rad/s bend a 0.1 s sweep by most of a metre; the truth straightens it again."""

    def motion(stamps_ns: IntArray) -> FloatArray:
        t = (stamps_ns - START_NS) * 1e-9
        return se3.from_yaw(1.0 * t, np.stack([8.0 * t, 0.5 * t, np.full(len(t), 1.5)], axis=1))

    rng = np.random.default_rng(0)
    scan = sweep(PERFECT.individual(rng), room, motion, START_NS, rng)[0]
    assert scan.times is not None
    stamps_ns = START_NS + np.round(scan.times * 1e9).astype(np.int64)
    deskewed = se3.transform(motion(stamps_ns), scan.points)
    skewed = se3.transform(motion(np.array([START_NS]))[0], scan.points)
    ahead = (deskewed[:, 0] > 15) & (np.abs(deskewed[:, 1]) < 7) & (deskewed[:, 2] > 0.1)
    assert ahead.sum() > 500
    assert np.abs(deskewed[ahead, 0] - 20).max() < 2e-3
    assert np.abs(skewed[ahead, 0] - 20).max() > 0.2


def test_every_lidar_has_its_beams() -> None:
    assert {name: (len(model.elevations_deg), model.columns) for name, model in LIDARS.items()} == {
        "hdl64": (64, 1800),
        "vlp16": (16, 1800),
        "vlp32": (32, 1800),
        "os1-64": (64, 1024),
        "generic-32": (32, 900),
    }
    assert all(np.all(np.diff(model.elevations_deg) > 0) for model in LIDARS.values())


@pytest.mark.parametrize(
    "change",
    [
        {"range_sigma_m": -0.1},
        {"dropout": 1.0},
        {"max_range_m": 0.2},
        {"rate_hz": 0.0},
        {"beam_sigma_m": -1.0},
        {"elevation_error_deg": 60.0},
        {"elevation_error_deg": float("nan")},
    ],
)
def test_impossible_lidars_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="lidar"):
        replace(PERFECT, **change)  # type: ignore[arg-type] # all of these fields are floats


def test_radio_passes_slight_things_but_not_solid_ones() -> None:
    builder = SceneBuilder(flat())
    builder.plant(cylinder(0.5, 4.0), 5, 0)
    builder.stand(box(1, 1, 4), 5, 10)
    scene = builder.build()
    start, end = np.array([[0.0, 0, 1], [0.0, 10, 1], [0, 0, 1]]), np.array([[10.0, 0, 1], [10.0, 10, 1], [0, 0, -3]])
    assert scene.obstacles(start, end).tolist() == [0, 2, 1]


def test_clearance_is_the_distance_to_the_nearest_surface(room: Scene) -> None:
    clearance = room.clearance(np.array([[0.0, 0, 1.5], [19.0, 0, 4.0], [-9.5, 0, 3.0]]))
    np.testing.assert_allclose(clearance, [1.5, 1.0, 0.5], atol=1e-4)
