"""The registered scenarios: deterministic, drivable, and refused where they make no sense."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.interfaces import ScanSource
from wiclosure.simulation import Scenario, ScenarioSettings, make_scenario
from wiclosure.simulation.motion import MotionSettings, drive
from wiclosure.types import FloatArray

Spoil = Callable[[FloatArray], FloatArray]


def settings(**changes: object) -> ScenarioSettings:
    return ScenarioSettings.model_validate(changes)


@pytest.fixture(scope="module")
def demo_site() -> Scenario:
    return make_scenario("demo-site")


def test_demo_site_is_short_and_its_robots_meet(demo_site: Scenario) -> None:
    alpha, beta = (demo_site.ground_truth(robot) for robot in ("alpha", "beta"))
    assert all(len(demo_site.scan_source(robot)) < 220 for robot in demo_site.robots)
    assert alpha.distance[-1] > 90
    assert beta.distance[-1] > 90
    apart = np.linalg.norm(alpha.positions[:, None] - beta.positions[None], axis=2)
    middle = alpha.positions[:, 1] > -5
    assert apart[middle].min() < 9
    assert apart[~middle].min() < 2


def test_scans_are_the_same_whenever_they_are_read(demo_site: Scenario) -> None:
    source = demo_site.scan_source("alpha")
    assert isinstance(source, ScanSource)
    first, again = list(islice(source, 3)), list(islice(source, 3))
    other = next(iter(make_scenario("demo-site").scan_source("alpha")))
    for a, b in zip([*first, first[0]], [*again, other], strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.times, b.times)
    assert not np.array_equal(first[0].points[:100], next(iter(demo_site.scan_source("beta"))).points[:100])


def test_scans_of_one_robot_differ_in_noise_with_the_seed(demo_site: Scenario) -> None:
    other = make_scenario("demo-site", settings(seed=1))
    a, b = (next(iter(scenario.scan_source("alpha"))) for scenario in (demo_site, other))
    assert a.points.shape != b.points.shape or not np.allclose(a.points, b.points)


def test_radio_is_deterministic_and_mentions_the_robots(demo_site: Scenario) -> None:
    log = demo_site.wireless()
    assert log == make_scenario("demo-site").wireless()
    assert log.robots() == {"alpha", "beta"}
    assert len(log.measurements) >= 15


def test_scan_stamps_lie_on_the_ground_truth(demo_site: Scenario) -> None:
    truth, source = demo_site.ground_truth("beta"), demo_site.scan_source("beta")
    assert len(truth) == len(source) + 1
    assert [scan.stamp_ns for scan in islice(source, 2)] == truth.stamps_ns[:2].tolist()


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("demosite", {}, "did you mean demo-site"),
        ("demo-site", {"robots": 0}, "0 robots"),
        ("demo-site", {"robots": 3}, "1 to 2"),
        ("demo-site", {"lidar": "hdl-64"}, "did you mean hdl64"),
        ("demo-site", {"lidar_max_range_m": 0.1}, "range is cut"),
    ],
)
def test_impossible_choices_are_refused_with_the_way_out(name: str, changes: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make_scenario(name, settings(**changes))


def poses_file(path: Path) -> Path:
    """KITTI poses (camera axes) of a loop that is driven once and a quarter, 900 frames of 0.6 m."""
    angle = np.arange(900) * 0.6 / 70
    z_forward, x_right = 70 * np.sin(angle), 70 - 70 * np.cos(angle)
    rows = np.zeros((900, 3, 4))
    rows[:, 0, 0] = rows[:, 2, 2] = np.cos(angle)
    rows[:, 0, 2], rows[:, 2, 0] = np.sin(angle), -np.sin(angle)
    rows[:, 1, 1] = 1.0
    rows[:, 0, 3], rows[:, 2, 3] = x_right, z_forward
    np.savetxt(path, rows.reshape(900, 12))
    return path


def test_streets_follow_recorded_poses_and_the_robots_start_together(tmp_path: Path) -> None:
    scenario = make_scenario("kitti08", settings(poses=poses_file(tmp_path / "loop.txt")))
    truth = [scenario.ground_truth(robot) for robot in scenario.robots]
    assert len(truth) == 3
    assert len({int(trajectory.stamps_ns[0]) for trajectory in truth}) == 1
    assert all(trajectory.distance[-1] == pytest.approx(0.6 * 299, rel=0.01) for trajectory in truth)
    # The camera looked along z and turned right: our robot drives along x and turns right as well.
    assert truth[0].positions[20, 0] - truth[0].positions[0, 0] == pytest.approx(12, abs=0.5)
    assert truth[0].positions[-1, 1] < -30
    scan = next(iter(scenario.scan_source("beta")))
    assert len(scan.points) > 50_000
    assert np.median(scan.points[np.linalg.norm(scan.points[:, :2], axis=1) < 8, 2]) == pytest.approx(-1.7, abs=0.3)


@pytest.mark.parametrize(
    ("content", "message"),
    [("1 2 3\n4 5 6\n", "expected 20 or more KITTI poses"), ("hello\n", "cannot read"), ("", "expected 20 or more")],
)
def test_a_poses_file_of_another_form_is_refused(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "poses.txt"
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        make_scenario("kitti08", settings(poses=path))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda rows: rows * np.tile([1.0, 1.0, 1.0, 1000.0], 3), "line 2: 1000 m from the line before"),
        (lambda rows: np.vstack([rows[:30], rows[60:]]), "line 31: 31 m from the line before"),
        (lambda rows: np.where(np.arange(len(rows))[:, None] == 40, np.nan, rows), "line 41: not all 12 numbers"),
    ],
)
def test_poses_that_no_car_drives_are_refused_with_their_line(tmp_path: Path, spoil: Spoil, message: str) -> None:
    rows = np.zeros((100, 3, 4))
    rows[:, :, :3] = np.eye(3)
    rows[:, 2, 3] = np.arange(100.0)
    np.savetxt(tmp_path / "poses.txt", spoil(rows.reshape(100, 12)))
    with pytest.raises(InputError, match=message):
        make_scenario("kitti08", settings(poses=tmp_path / "poses.txt"))


def test_kitti08_asks_for_poses() -> None:
    with pytest.raises(ConfigError, match="--poses FILE"):
        make_scenario("kitti08")


def test_standing_still_is_not_a_drive(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    np.savetxt(path, np.tile(np.eye(4)[:3].ravel(), (50, 1)))
    with pytest.raises(InputError, match="less than 50 m"):
        make_scenario("kitti08", settings(poses=path))


@pytest.mark.parametrize("name", ["shell-space", "city", "campus", "static-mirror"])
def test_every_robot_sees_and_hears(name: str) -> None:
    scenario = make_scenario(name)
    for robot in scenario.robots:
        assert len(next(iter(scenario.scan_source(robot))).points) > 3_000
    assert len(scenario.wireless().measurements) >= 4


def test_shell_space_is_the_papers_experiment() -> None:
    scenario = make_scenario("shell-space")
    log = scenario.wireless()
    assert [len(measurement.paths) for measurement in log.measurements] == [5, 5, 5, 5]
    assert {heading.robot for heading in log.headings} == {"alpha", "beta"}
    scan = next(iter(scenario.scan_source("alpha")))
    assert np.linalg.norm(scan.points, axis=1).max() <= 10.0


def test_campus_has_neighbours_that_meet_and_others_that_never_do() -> None:
    scenario = make_scenario("campus")
    positions = [scenario.ground_truth(robot).positions for robot in scenario.robots]
    apart = np.array([[np.linalg.norm(a[:, None] - b[None], axis=2).min() for b in positions] for a in positions])
    assert (apart[[0, 1, 2], [1, 2, 3]] < 5).all()
    assert apart[0, 2] > 30
    assert (apart[4, :4] > 100).all()


def test_aliasing_makes_houses_alike() -> None:
    def spread(aliasing: float) -> float:
        walls = make_scenario("city", settings(aliasing=aliasing)).scene.reflectors
        return float(np.std([np.linalg.norm(wall.end_m - wall.start_m) for wall in walls[::4]]))

    assert spread(1.0) < 1e-3
    assert spread(0.0) > 0.5


def test_a_drive_through_a_wall_is_refused(demo_site: Scenario) -> None:
    ground = demo_site.scene.ground
    motion = drive(np.array([[-28.0, 0.0], [0.0, -1.0]]), ground, MotionSettings())
    with pytest.raises(ConfigError, match=r"robot alpha runs into something near \(-2[12]"):
        Scenario("broken", demo_site.scene, {"alpha": motion}, demo_site.lidar, demo_site.radio)
