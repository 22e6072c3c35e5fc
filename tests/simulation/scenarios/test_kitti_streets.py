"""Streets along recorded poses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.simulation import ScenarioSettings, make_scenario
from wiclosure.types import FloatArray

Spoil = Callable[[FloatArray], FloatArray]


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
    scenario = make_scenario("kitti08", ScenarioSettings(poses=poses_file(tmp_path / "loop.txt")))
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
        make_scenario("kitti08", ScenarioSettings(poses=path))


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
        make_scenario("kitti08", ScenarioSettings(poses=tmp_path / "poses.txt"))


def test_kitti08_asks_for_poses() -> None:
    with pytest.raises(ConfigError, match="--poses FILE"):
        make_scenario("kitti08")


def test_standing_still_is_not_a_drive(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    np.savetxt(path, np.tile(np.eye(4)[:3].ravel(), (50, 1)))
    with pytest.raises(InputError, match="less than 50 m"):
        make_scenario("kitti08", ScenarioSettings(poses=path))
