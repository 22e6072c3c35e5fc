"""Pictures of a finished run: one place seen by two robots, their odometry frames 5 m apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.config import load_config
from wiclosure.pipeline.data.dataset_file import write_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.report import pictures
from wiclosure.pipeline.report.illustrations import Sketch, illustrate_arms, illustrate_run, merged_view
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.run import candidate_filter, prepare, run_stages
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import Scan, Trajectory

STAMPS_NS = 10**9 + np.arange(3) * 10**8
TRUE_M = np.array([100.0, 50.0, 2.0])


def room_scans() -> list[Scan]:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (3000, 3)) * [10, 8, 3]
    wall = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), wall] = np.sign(points[np.arange(len(points)), wall]) * np.array([10, 8, 3])[wall]
    return [Scan(int(stamp_ns), points) for stamp_ns in STAMPS_NS]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    folder = tmp_path_factory.mktemp("room")
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = TRUE_M + np.arange(3)[:, None] * [1e-3, 2e-3, 0.0]
    robots = {}
    for robot in ("alpha", "beta"):
        write_kitti_folder(folder / robot, room_scans())
        write_tum(folder / f"{robot}.tum", Trajectory(robot, STAMPS_NS, poses))
        robots[robot] = RobotRecording(folder / robot, ground_truth=folder / f"{robot}.tum")
    write_dataset(folder / "dataset.yaml", robots)
    config = load_config(overrides=["odometry.num_threads=1"])
    inputs = open_inputs([str(folder)])
    prepared = prepare(inputs, config, cache=StageCache(None), jobs=1, progress=NoProgress())
    return run_stages(prepared, candidate_filter("none", inputs, config), progress=NoProgress())


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few pixels, for speed."""
    monkeypatch.setattr(pictures, "DPI", 40)


def test_what_is_connected_lies_over_ground_truth(result: RunResult) -> None:
    view = merged_view(result)
    assert set(view.odometry) == {"alpha", "beta"}
    assert set(view.paths) == set(view.truth) == set(result.solution.graph.components[0])
    for robot, xy_m in view.paths.items():
        np.testing.assert_allclose(xy_m, np.tile(TRUE_M[:2], (3, 1)), atol=0.05)
        np.testing.assert_allclose(view.truth[robot][0], TRUE_M[:2])
    assert len(view.closures) == len(view.false) == len(result.solution.graph.accepted)
    assert not view.false.any()


def test_pictures_of_a_run_and_of_arms(result: RunResult, tmp_path: Path) -> None:
    illustrate_run(tmp_path, result)
    assert {path.name for path in tmp_path.iterdir()} == {"trajectories.png", "map.png", "candidates_alpha_beta.png"}
    (tmp_path / "arms").mkdir()
    illustrate_arms(tmp_path / "arms", {"none": Sketch.of(result), "oracle": Sketch.of(result)})
    assert {path.name for path in (tmp_path / "arms").iterdir()} == {"trajectories.png", "candidates_alpha_beta.png"}
