"""A run's files: all join by the scans' own stamps; odometry may start anywhere; ground truth stops nothing."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.trajectories.tum import read_tum, write_tum
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.dataset_writer import write_ros2_bag
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.run import candidate_filter, prepare, run_stages
from wiclosure.pipeline.stages.run_folder import read_evaluation_settings, read_metrics, read_trajectories, write_run
from wiclosure.types import Scan, Trajectory

UTM_M = np.array([458_058.6, 5_429_380.2, 162.9])
HEADERS_NS = 1_700_000_000 * 10**9 + np.arange(8) * 10**8


def hall() -> np.ndarray:
    """Points on the walls and pillars of a hall that looks different from everywhere."""
    rng = np.random.default_rng(0)
    boxes = [(rng.uniform(-18, 18, 2), rng.uniform(0.3, 3, 2)) for _ in range(25)] + [(np.zeros(2), np.full(2, 20.0))]
    points = []
    for centre, half in boxes:
        side, along = rng.integers(0, 4, 600), rng.uniform(-1, 1, 600)
        x = np.where(side < 2, along, np.where(side == 2, 1, -1))
        y = np.where(side < 2, np.where(side == 0, 1, -1), along)
        points.append(np.column_stack([centre[0] + x * half[0], centre[1] + y * half[1], rng.uniform(-1, 3, 600)]))
    return np.concatenate(points)


def write_robot(folder: Path, robot: str, start: np.ndarray) -> Trajectory:
    """A bag whose sweeps begin at their stamps, and the path at 100 Hz."""
    stamps_ns = np.arange(HEADERS_NS[0] - 10**8, HEADERS_NS[-1] + 3 * 10**8, 10**7)
    seconds = (stamps_ns - HEADERS_NS[0])[:, None] * 1e-9
    way = Trajectory(robot, stamps_ns, se3.from_yaw(0.3 * seconds[:, 0], start + seconds * [6.0, 1.0, 0.0]))
    rng, world, scans = np.random.default_rng(1), hall(), []
    for stamp_ns in HEADERS_NS.tolist():
        times = np.sort(rng.uniform(0, 0.1, len(world)))
        T_world_body = way.at(stamp_ns + np.rint(times * 1e9).astype(np.int64))
        points = np.einsum("nji,nj->ni", T_world_body[:, :3, :3], world - T_world_body[:, :3, 3])
        scans.append(Scan(stamp_ns, points + rng.normal(0, 0.005, points.shape), times))
    write_ros2_bag(folder / robot, scans)
    return way


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of two robots: odometry in UTM, ground truth of one of them broken."""
    folder = tmp_path_factory.mktemp("run")
    T_utm_world = np.eye(4)
    T_utm_world[:3, 3] = UTM_M
    for robot, start in (("alpha", np.zeros(3)), ("beta", np.array([1.0, -1.0, 0.0]))):
        way = write_robot(folder, robot, start)
        write_tum(folder / f"{robot}_odom.tum", way.moved(T_utm_world))
        write_tum(folder / f"{robot}_gt.tum", way)
    (folder / "beta_gt.tum").write_text("no trajectory at all\n")
    (folder / "dataset.yaml").write_text(
        "robots:\n"
        "  alpha: {scans: alpha, ground_truth: alpha_gt.tum, odometry: alpha_odom.tum}\n"
        "  beta: {scans: beta, ground_truth: beta_gt.tum, odometry: beta_odom.tum}\n"
    )
    config = Config.model_validate({"keyframes": {"distance_m": 0.3}})
    inputs = open_inputs([str(folder)])
    prepared = prepare(inputs, config, cache=StageCache(None), jobs=1, progress=NoProgress())
    (folder / "out").mkdir()
    result = run_stages(prepared, candidate_filter("none", inputs, config), progress=NoProgress())
    write_run(folder / "out", result)
    return folder


def test_trajectories_carry_the_scans_own_stamps(folder: Path) -> None:
    for name in ("alpha", "beta", "alpha_odometry", "beta_odometry", "alpha_ground_truth"):
        np.testing.assert_array_equal(read_tum(folder / "out" / f"{name}.tum", "a").stamps_ns, HEADERS_NS)


def test_poses_are_those_at_these_stamps(folder: Path) -> None:
    truth = read_tum(folder / "alpha_gt.tum", "alpha")
    written = read_tum(folder / "out" / "alpha_ground_truth.tum", "alpha")
    np.testing.assert_allclose(written.poses, truth.at(HEADERS_NS), atol=1e-12)
    merged = read_tum(folder / "out" / "alpha.tum", "alpha")
    moved = se3.between(merged.poses[0], merged.poses[-1])
    np.testing.assert_allclose(moved, se3.between(written.poses[0], written.poses[-1]), atol=0.02)


def test_odometry_is_in_the_frame_that_it_came_in_and_the_map_near_its_origin(folder: Path) -> None:
    odometry = read_tum(folder / "out" / "alpha_odometry.tum", "alpha")
    np.testing.assert_allclose(odometry.positions[0], UTM_M, atol=1e-3)
    assert np.abs(read_tum(folder / "out" / "beta.tum", "beta").positions).max() < 1000
    assert (folder / "out" / "map.ply").stat().st_size > 10_000


def test_candidates_and_closures_join_by_them(folder: Path) -> None:
    stamps = {f"{ns // 10**9}.{ns % 10**9:09d}" for ns in HEADERS_NS.tolist()}
    for name, columns in (("candidates", ("stamp_a", "stamp_b")), ("closures", ("query_stamp", "match_stamp"))):
        with (folder / "out" / f"{name}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        assert rows
        assert {row[column] for row in rows for column in columns} <= stamps


def test_closures_are_between_the_bodies_at_these_stamps(folder: Path) -> None:
    truth = {robot: read_tum(folder / f"{robot}_odom.tum", robot) for robot in ("alpha", "beta")}
    with (folder / "out" / "closures.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["decision"] == "accepted"]
    assert rows
    for row in rows:
        ends = [
            truth[row[f"{end}_robot"]].at(np.array([round(float(row[f"{end}_stamp"]) * 10) * 10**8]))[0]
            for end in ("query", "match")
        ]
        measured = np.array([float(row[axis]) for axis in "xyz"])
        np.testing.assert_allclose(measured, se3.between(*ends)[:3, 3], atol=0.05)


def test_broken_ground_truth_is_reported_and_left_out(folder: Path) -> None:
    _, truth = read_trajectories(folder / "out")
    assert list(truth) == ["alpha"]
    assert "beta: ground truth is left out" in (folder / "out" / "metrics.json").read_text()


@pytest.mark.parametrize(
    "metrics",
    ["[]", "{}", '{"components": 3}', '{"components": [{"robotse": []}]}', '{"components": [{"robots": [1]}]}'],
)
def test_metrics_of_something_else_are_refused(tmp_path: Path, metrics: str) -> None:
    (tmp_path / "metrics.json").write_text(metrics)
    with pytest.raises(InputError, match=r"metrics\.json does not hold the metrics of a run"):
        read_metrics(tmp_path)


def test_settings_of_an_evaluation_are_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("evaluation: {sigma_m: 1.0}")
    with pytest.raises(InputError, match=r"unknown configuration key sigma_m in .*config\.yaml; [^\n]*$"):
        read_evaluation_settings(tmp_path)
