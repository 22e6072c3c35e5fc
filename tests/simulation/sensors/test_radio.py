"""Radio: exact without noise, mirrored exactly, blocked by walls, and as noisy as asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.errors import ConfigError, InputError
from wiclosure.simulation import RadioSettings, make_scenario, simulate_wireless_from_poses
from wiclosure.simulation.sensors.propagation import InScene, mirror
from wiclosure.simulation.sensors.radio import simulate_wireless
from wiclosure.simulation.sensors.schedule import LinkWindow, link_is_up, read_schedule
from wiclosure.simulation.world.ground import Ground
from wiclosure.simulation.world.mesh import box
from wiclosure.simulation.world.scene import Footprint, Reflector, Scene, SceneBuilder
from wiclosure.types import FloatArray, Trajectory, WirelessMeasurement

SILENT = {
    "range_sigma_m": 0.0,
    "range_bias_blocked_m": 0.0,
    "gross_ranges": 0.0,
    "azimuth_sigma_deg": 0.0,
    "direct_absent": 0.0,
    "direct_absent_blocked": 0.0,
    "dropout": 0.0,
    "paths": 1,
    "elevations": True,
}


def radio(**changes: object) -> RadioSettings:
    return RadioSettings.model_validate(changes)


def noise_free(**changes: object) -> RadioSettings:
    return radio(**{**SILENT, **changes})


def wandering(robot: str, seed: int, count: int = 300, radius_m: float = 20.0) -> Trajectory:
    """A robot on a tilted loop, one pose a second."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 6.0, count) + rng.uniform(0, 6)
    centre = np.array([*rng.uniform(-20, 20, 2), rng.uniform(-1, 1)])
    around = np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle), np.sin(angle)], axis=1)
    T = se3.from_yaw(angle + np.pi / 2, centre + around)
    T[:, :3, :3] @= se3.exp(np.array([0.1, -0.05, 0, 0, 0, 0.0]))[:3, :3]
    return Trajectory(robot, np.arange(count, dtype=np.int64) * 10**9, T)


def two_robots(count: int = 300) -> dict[str, Trajectory]:
    return {"alpha": wandering("alpha", 1, count), "beta": wandering("beta", 2, count)}


def truth_of(measurements: Sequence[WirelessMeasurement], robots: dict[str, Trajectory]) -> FloatArray:
    """Vectors `(N, 3)` from receiver to transmitter in the receiver's body axes."""
    stamps = np.array([m.stamp_ns for m in measurements])
    poses = {name: robot.at(stamps) for name, robot in robots.items()}
    T_receiver = np.array([poses[m.receiver][row] for row, m in enumerate(measurements)])
    transmitter = np.array([poses[m.transmitter][row, :3, 3] for row, m in enumerate(measurements)])
    return se3.transform(se3.inverse(T_receiver), transmitter)


@pytest.mark.parametrize("direction", ["one-way", "reciprocal"])
def test_without_noise_ranges_and_bearings_are_exact(direction: str) -> None:
    robots = two_robots()
    log = simulate_wireless_from_poses(robots, noise_free(every_m=5.0, direction=direction), seed=0)
    assert {m.receiver for m in log.measurements} == ({"alpha"} if direction == "one-way" else {"alpha", "beta"})
    assert len(log.measurements) >= 20
    for measurement, (x, y, z) in zip(log.measurements, truth_of(log.measurements, robots), strict=True):
        assert measurement.range_m == pytest.approx(np.linalg.norm([x, y, z]))
        (path,) = measurement.paths
        assert path.azimuth == pytest.approx(np.arctan2(y, x))
        assert path.elevation == pytest.approx(np.arctan2(z, np.hypot(x, y)))


@pytest.mark.parametrize(("frame", "turn_rad"), [("odometry", None), ("world", 0.0)])
def test_bearings_in_other_axes(frame: str, turn_rad: float | None) -> None:
    robots = two_robots()
    log = simulate_wireless_from_poses(robots, noise_free(aoa_frame=frame), seed=0)
    R_world_axes = robots["alpha"].poses[0, :3, :3] if turn_rad is None else np.eye(3)
    for measurement in log.measurements:
        at = np.array([measurement.stamp_ns])
        apart = (robots["beta"].at(at) - robots["alpha"].at(at))[0, :3, 3] @ R_world_axes
        assert measurement.paths[0].azimuth == pytest.approx(np.arctan2(apart[1], apart[0]))
        assert measurement.aoa_frame == frame


def test_a_measurement_every_few_metres_or_seconds() -> None:
    robots = two_robots()
    by_distance = simulate_wireless_from_poses(robots, noise_free(every_m=7.0), seed=0)
    stamps = np.array([m.stamp_ns for m in by_distance.measurements])
    travelled = np.interp(stamps, robots["alpha"].stamps_ns, robots["alpha"].distance)
    np.testing.assert_allclose(travelled, 7.0 * np.arange(1, len(stamps) + 1), atol=1e-3)
    by_time = simulate_wireless_from_poses(robots, noise_free(every_m=None, every_s=10.0), seed=0)
    assert [m.stamp_ns for m in by_time.measurements] == [10**10 * k for k in range(1, 30)]
    with pytest.raises(ConfigError, match="every_m or every_s"):
        simulate_wireless_from_poses(robots, noise_free(every_m=None), seed=0)


def test_noise_is_as_asked_for() -> None:
    robots = two_robots(12_000)
    asked = radio(every_m=None, every_s=2.0, range_sigma_m=0.4, gross_ranges=0.0, azimuth_sigma_deg=8.0,
                  direct_absent=0.2, dropout=0.1, paths=5)  # fmt: skip
    log = simulate_wireless_from_poses(robots, asked, seed=3)
    assert len(log.measurements) / 5_999 == pytest.approx(0.9, abs=0.01)
    truth = truth_of(log.measurements, robots)
    ranges = np.array([m.range_m for m in log.measurements])
    assert (ranges - np.linalg.norm(truth, axis=1)).std() == pytest.approx(0.4, rel=0.05)
    azimuths = np.array([[path.azimuth for path in m.paths] for m in log.measurements])
    off = np.arctan2(truth[:, 1], truth[:, 0])[:, None] - azimuths
    off = np.abs(np.arctan2(np.sin(off), np.cos(off)))
    assert azimuths.shape[1] == 5
    # With the direct path the nearest of five is it; a uniform false path comes within 3 sigma now and then too.
    false_near = 1 - (1 - np.deg2rad(24.0) / np.pi) ** 5
    assert (off.min(axis=1) < np.deg2rad(24.0)).mean() == pytest.approx(0.8 + 0.2 * false_near, abs=0.02)
    strongest = off[off[:, 0] < np.deg2rad(40), 0]
    assert np.median(strongest) == pytest.approx(0.6745 * np.deg2rad(8.0), rel=0.15)


def test_defaults_are_like_real_wifi_profiles() -> None:
    """Real: strongest path off by 7.5 degrees (median), by over 30 in 10-23 %; a path within 15 degrees in 71-85 %."""
    robots = two_robots(12_000)
    log = simulate_wireless_from_poses(robots, radio(every_m=None, every_s=2.0), seed=0)
    errors = []
    for measurement, (x, y, _) in zip(log.measurements, truth_of(log.measurements, robots), strict=True):
        off = np.arctan2(y, x) - np.array([path.azimuth for path in measurement.paths])
        errors.append(np.rad2deg(np.abs(np.arctan2(np.sin(off), np.cos(off)))))
    strongest = np.array([error[0] for error in errors])
    assert 6.5 < np.median(strongest) < 9.0
    assert 0.10 < (strongest > 30).mean() < 0.23
    assert 0.71 < np.mean([error.min() < 15 for error in errors]) < 0.87
    assert 0.5 < np.mean([len(error) == 1 for error in errors]) < 0.6


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3), st.floats(0.5, 40), st.floats(-np.pi, np.pi))
@settings(max_examples=60, deadline=None)
def test_mirror_images_are_mirror_images(x: float, y: float, z: float, length_m: float, yaw: float) -> None:
    start = np.array([3.0, -2.0])
    wall = Reflector(start, start + length_m * np.array([np.cos(yaw), np.sin(yaw)]), 0.0, 3.0)
    point = np.array([[x, y, z]])
    image = mirror(wall, point)
    np.testing.assert_allclose(mirror(wall, image), point, atol=1e-9)
    foot = np.array([wall.start_m, wall.end_m])
    np.testing.assert_allclose(
        np.linalg.norm(foot - image[:, :2], axis=1), np.linalg.norm(foot - point[:, :2], axis=1), atol=1e-9
    )
    assert image[0, 2] == z


def yard() -> Scene:
    """A long wall with its near face at y = 10, and a block around (0, 0) that stands between the robots."""
    axis = np.linspace(-80, 80, 5)
    builder = SceneBuilder(Ground(axis, axis, np.zeros((5, 5))))
    builder.building(box(100, 1.0, 6), Footprint(100, 1.0, 6), 0, 10.5)
    builder.building(box(4, 4, 4), Footprint(4, 4, 4), 0, 0)
    return builder.build()


def standing(robot: str, x_m: float, y_m: float) -> Trajectory:
    poses = se3.from_yaw(np.zeros(101), np.tile([x_m, y_m, 1.0], (101, 1)))
    return Trajectory(robot, np.arange(101, dtype=np.int64) * 10**9, poses)


def test_a_wall_makes_a_virtual_transmitter_exactly_behind_it() -> None:
    scene = yard()
    receiver, transmitter = np.array([[-12.0, 1.0, 1.0]]), np.array([[14.0, 0.0, 1.0]])
    reflections = InScene(scene).reflections(receiver, transmitter)
    np.testing.assert_allclose(reflections.virtual_m, [[14.0, 20.0, 1.0]], atol=1e-9)
    assert InScene(scene).blocked(receiver, transmitter).tolist() == [True]
    aside = np.array([0.0, 5.0, 0.0])
    assert InScene(scene).blocked(receiver + aside, transmitter + aside).tolist() == [False]


def test_no_reflection_from_beside_or_above_the_wall_or_where_a_leg_is_blocked() -> None:
    scene = yard()
    short = replace(scene, reflectors=(Reflector(np.array([20.0, 10.0]), np.array([30.0, 10.0]), 0.0, 6.0),))
    low = replace(scene, reflectors=(Reflector(np.array([-50.0, 10.0]), np.array([50.0, 10.0]), 0.0, 0.5),))
    receiver, transmitter = np.array([[-12.0, 1.0, 1.0]]), np.array([[14.0, 0.0, 1.0]])
    for other in (short, low):
        assert len(InScene(other).reflections(receiver, transmitter).transmission) == 0
    # South of the block only its own face mirrors: it stands between there and the wall.
    south = np.array([[0.0, -5.0, 1.0]]), np.array([[0.5, -6.0, 1.0]])
    np.testing.assert_allclose(InScene(scene).reflections(*south).virtual_m, [[0.5, 2.0, 1.0]])


def test_a_static_mirror_shows_the_same_wrong_direction_all_the_time() -> None:
    robots = {"alpha": standing("alpha", -12.0, 1.0), "beta": standing("beta", 14.0, 0.0)}
    settings = noise_free(every_m=None, every_s=1.0, direct_absent_blocked=1.0)
    log = simulate_wireless(robots, yard(), settings, seed=0)
    assert len(log.measurements) > 90
    azimuth = [path.azimuth for m in log.measurements for path in m.paths]
    np.testing.assert_allclose(azimuth, np.arctan2(19.0, 26.0), atol=1e-9)


def test_walls_bias_ranges_and_hide_the_direct_path() -> None:
    robots = {"alpha": standing("alpha", -12.0, 1.0), "beta": standing("beta", 14.0, 0.0)}
    settings = radio(every_m=None, every_s=0.05, range_bias_blocked_m=0.8, gross_ranges=0.0, dropout=0.0,
                     direct_absent_blocked=0.4, azimuth_sigma_deg=1.0, paths=2)  # fmt: skip
    log = simulate_wireless(robots, yard(), settings, seed=0)
    bias = np.mean([(m.range_m or 0.0) - np.hypot(26.0, 1.0) for m in log.measurements])
    assert bias == pytest.approx(0.8, abs=0.06)
    direct = [any(abs(p.azimuth - np.arctan2(-1.0, 26.0)) < 0.07 for p in m.paths) for m in log.measurements]
    assert np.mean(direct) == pytest.approx(0.6, abs=0.04)
    mirrored = [any(abs(p.azimuth - np.arctan2(19.0, 26.0)) < 0.07 for p in m.paths) for m in log.measurements]
    assert np.mean(mirrored) > 0.97


def test_reach_is_shorter_through_walls() -> None:
    robots = {"alpha": standing("alpha", -12.0, 1.0), "beta": standing("beta", 14.0, 0.0)}
    asked = {"every_m": None, "every_s": 1.0, "max_range_m": 40.0}
    assert len(simulate_wireless(robots, yard(), noise_free(**asked, blocked_range=0.5), 0).measurements) == 0
    assert len(simulate_wireless(robots, yard(), noise_free(**asked, blocked_range=0.7), 0).measurements) > 90
    assert len(simulate_wireless_from_poses(robots, noise_free(**asked, blocked_range=0.5), 0).measurements) > 90


def heading_errors_deg(robots: dict[str, Trajectory], settings: RadioSettings) -> FloatArray:
    log = simulate_wireless_from_poses(robots, settings, 0)
    assert [h.stamp_ns for h in log.headings] == sorted(h.stamp_ns for h in log.headings)
    alphas = [heading for heading in log.headings if heading.robot == "alpha"]
    yaw = se3.yaw(robots["alpha"].at(np.array([heading.stamp_ns for heading in alphas])))
    off = np.array([heading.heading for heading in alphas]) - yaw
    return np.rad2deg(np.arctan2(np.sin(off), np.cos(off)))


def test_headings_only_with_a_compass() -> None:
    robots = two_robots()
    assert simulate_wireless_from_poses(robots, noise_free(), 0).headings == ()
    compass = noise_free(heading_sigma_deg=2.0, heading_every_s=0.1, heading_memory_s=0.0)
    assert heading_errors_deg(robots, compass).std() == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize("memory_s", [0.0, 3.0])
def test_a_compass_is_wrong_alike_for_a_while(memory_s: float) -> None:
    compass = noise_free(heading_sigma_deg=2.0, heading_every_s=1.0, heading_memory_s=memory_s)
    off = heading_errors_deg(two_robots(3000), compass)
    assert off.std() == pytest.approx(2.0, rel=0.1)
    alike = np.corrcoef(off[:-1], off[1:])[0, 1]
    assert alike == pytest.approx(np.exp(-1 / memory_s) if memory_s else 0.0, abs=0.06)


def test_ranges_or_bearings_alone() -> None:
    robots = two_robots()
    assert all(
        m.range_m is None and m.paths
        for m in simulate_wireless_from_poses(robots, radio(ranging=False), 0).measurements
    )
    assert all(
        m.range_m and not m.paths for m in simulate_wireless_from_poses(robots, radio(bearings=False), 0).measurements
    )


def test_same_seed_same_log() -> None:
    robots = two_robots()
    assert simulate_wireless_from_poses(robots, radio(), 5) == simulate_wireless_from_poses(robots, radio(), 5)
    assert simulate_wireless_from_poses(robots, radio(), 5) != simulate_wireless_from_poses(robots, radio(), 6)


def test_schedule_limits_when_robots_talk(tmp_path: Path) -> None:
    path = tmp_path / "schedule.csv"
    path.write_text("start_s,end_s,robot_a,robot_b\n50, 100,beta,alpha\n200,220,,\n0,300,gamma,\n")
    schedule = read_schedule(path)
    log = simulate_wireless_from_poses(two_robots(), noise_free(every_m=None, every_s=5.0, schedule=schedule), 0)
    seconds = [m.stamp_ns // 10**9 for m in log.measurements]
    assert seconds == [*range(50, 101, 5), *range(200, 221, 5)]
    assert link_is_up(None, "alpha", "beta", np.array([1.0, 2.0])).all()
    assert not link_is_up((LinkWindow(start_s=0, end_s=9, robot_a="gamma"),), "alpha", "beta", np.array([1.0])).any()


def test_a_schedule_without_windows_is_silence_and_a_byte_order_mark_is_nothing(tmp_path: Path) -> None:
    path = tmp_path / "schedule.csv"
    path.write_text("\ufeffstart_s,end_s\n", encoding="utf-8")
    robots, talkative = two_robots(), noise_free(every_m=None, every_s=5.0)
    assert simulate_wireless_from_poses(robots, talkative, 0).measurements
    silent = talkative.model_copy(update={"schedule": read_schedule(path)})
    assert not simulate_wireless_from_poses(robots, silent, 0).measurements


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("from,to\n1,2\n", "expected start_s,end_s"),
        ("", "columns are none"),
        ("start_s,end_s\n1,2\nx,3\n", "line 3"),
        ("start_s,end_s\n5,2\n", "line 2: the window ends"),
        ("start_s,end_s\n-5,2\n", "line 2"),
        ("start_s,end_s\n1,nan\n", "line 2"),
        ("start_s,end_s\n1\n", "line 2: fewer values"),
        ("start_s,end_s,robot_a\n1,2\n", "line 2: fewer values"),
        ("start_s,end_s\n1,2,3\n", "line 2: more values"),
        ("start_s,end_s,robot_a,robot_b\n1,2,alpha,alpha\n", "line 2: .* both are alpha"),
    ],
)
def test_a_wrong_schedule_is_refused_with_its_line(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "schedule.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        read_schedule(path)
    with pytest.raises(InputError, match="cannot read"):
        read_schedule(tmp_path / "missing.csv")


def test_static_mirror_scenario_hears_the_wall_only() -> None:
    scenario = make_scenario("static-mirror")
    truth = {robot: scenario.ground_truth(robot) for robot in scenario.robots}
    azimuths = np.array([m.paths[0].azimuth for m in scenario.wireless().measurements])
    direct = truth_of(scenario.wireless().measurements, truth)
    off = np.rad2deg(azimuths - np.arctan2(direct[:, 1], direct[:, 0]))
    assert len(off) > 20
    assert np.median(off) == pytest.approx(40, abs=10)
    assert np.abs(off - np.median(off)).max() < 45
