from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import ConfigError, InputError, ProcessError
from wiclosure.frontends.config import KeyframeSettings, OdometrySettings
from wiclosure.frontends.front_end import OdometryRun
from wiclosure.frontends.front_end_result import FrontEndResult
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.inputs import RobotInput
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.runtime import checkpoints
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.checkpoints import Checkpoints
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.odometry import front_ends, odometry_settings, remarks
from wiclosure.types import Scan, Trajectory


class Listed:
    """Scans from memory; says how many are announced."""

    def __init__(self, scans: Sequence[Scan], announced: int) -> None:
        self._scans, self._announced = scans, announced
        self.description = "list"

    def __len__(self) -> int:
        return self._announced

    def __iter__(self) -> Iterator[Scan]:
        return iter(self._scans)


def room(seed: int, n: int = 2000) -> np.ndarray:
    """Points on the walls of a box."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (n, 3)) * [10, 8, 3]
    wall = rng.integers(0, 3, n)
    points[np.arange(n), wall] = np.sign(points[np.arange(n), wall]) * np.array([10, 8, 3])[wall]
    return points


SCANS = [Scan(10**9 + k * 10**8, room(k)) for k in range(5)]


def robot(scans: Sequence[Scan], announced: int | None = None, name: str = "alpha") -> RobotInput:
    listed = Listed(scans, announced or len(scans))
    return RobotInput(name, listed, [name, [s.stamp_ns for s in scans]], None)


def run(robots: Sequence[RobotInput], cache: Path | None = None) -> tuple[list[int], tuple[str, ...]]:
    fronts, reused = front_ends(robots, Config(), cache=StageCache(cache), jobs=1, progress=NoProgress())
    return [len(front.odometry) for front in fronts.values()], reused


def test_unusable_scans_are_skipped_and_counted() -> None:
    empty = replace(SCANS[2], points=np.zeros((0, 3)))
    back = replace(SCANS[3], stamp_ns=SCANS[0].stamp_ns)
    again = replace(SCANS[3], stamp_ns=SCANS[1].stamp_ns)
    source = robot([SCANS[0], SCANS[1], again, empty, back, SCANS[4]], announced=7)
    fronts, _ = front_ends([source], Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    assert fronts["alpha"].odometry.stamps_ns.tolist() == [SCANS[k].stamp_ns for k in (0, 1, 4)]
    assert remarks(source, fronts["alpha"], Config()) == (
        "alpha: 1 of 6 scans have too few points in range and were skipped",
        "alpha: 2 of 6 scans have stamps that repeat or go back and were skipped",
        "alpha: only 6 of 7 announced scans could be read",
    )


def test_nothing_is_said_of_a_whole_recording() -> None:
    source = robot(SCANS)
    fronts, _ = front_ends([source], Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    assert remarks(source, fronts["alpha"], Config()) == ()


def test_no_usable_scan_names_the_robot() -> None:
    with pytest.raises(InputError, match="alpha"):
        run([robot([Scan(0, np.zeros((0, 3)))])])


def test_finished_robots_are_not_computed_again(tmp_path: Path) -> None:
    alpha, beta = robot(SCANS), robot(SCANS[:3], name="beta")
    assert run([alpha], tmp_path) == ([5], ())
    assert run([alpha, beta], tmp_path) == ([5, 3], ("alpha",))


def test_settings_that_a_stage_does_not_use_do_not_compute_it_again(tmp_path: Path) -> None:
    def computed(**settings: object) -> int:
        cache = StageCache(tmp_path)
        config = Config.model_validate(settings)
        before = sum(stage.entries for stage in cache.stock())
        front_ends([robot(SCANS)], config, cache=cache, jobs=1, progress=NoProgress())
        return sum(stage.entries for stage in cache.stock()) - before

    assert computed() == 2
    assert computed(drift={"translation_walk": 0.5}, odometry={"num_threads": 2}, matching={"max_distance": 0.1}) == 0
    assert computed(scan_context={"rings": 10}) == 1
    assert computed(keyframes={"distance_m": 2.0}) == 2


def test_one_odometry_serves_configurations_of_which_only_keyframes_differ(tmp_path: Path) -> None:
    fine, coarse = Config(), Config.model_validate({"keyframes": {"distance_m": 2.0, "cloud_voxel_size_m": 0.3}})
    other = Config.model_validate({"odometry": {"voxel_size_m": 0.7}})
    cache = StageCache(tmp_path)
    front_ends([robot(SCANS)], fine, cache=cache, jobs=1, progress=NoProgress(), also=[coarse, other])
    found, reused = front_ends([robot(SCANS)], coarse, cache=cache, jobs=1, progress=NoProgress())
    assert reused == ("alpha",)
    alone, _ = front_ends([robot(SCANS)], coarse, cache=StageCache(None), jobs=1, progress=NoProgress())
    assert found["alpha"].keyframe_indices.tolist() == alone["alpha"].keyframe_indices.tolist()
    for cloud, expected in zip(found["alpha"].clouds, alone["alpha"].clouds, strict=True):
        np.testing.assert_array_equal(cloud, expected)
    assert front_ends([robot(SCANS)], other, cache=cache, jobs=1, progress=NoProgress())[1] == ()


def test_waiting_for_scans_is_told_from_following_them() -> None:
    class Slow(Listed):
        def __iter__(self) -> Iterator[Scan]:
            for scan in super().__iter__():
                time.sleep(0.1)
                yield scan

    source = RobotInput("alpha", Slow(SCANS, len(SCANS)), "alpha", None)
    began = time.perf_counter()
    fronts, _ = front_ends([source], Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    elapsed_s = time.perf_counter() - began
    assert 0.1 * len(SCANS) <= fronts["alpha"].seconds_reading <= elapsed_s - fronts["alpha"].seconds_odometry


def test_a_worker_that_is_killed_is_told_in_one_sentence(tmp_path: Path) -> None:
    data = []
    for name in ("alpha", "beta"):
        write_kitti_folder(tmp_path / name, [replace(SCANS[0], stamp_ns=k * 10**8) for k in range(200)])
        data.append(f"{name}={tmp_path / name}")

    def kill() -> None:
        while len(workers := active_children()) < 2:
            time.sleep(0.01)
        workers[0].kill()

    killer = Thread(target=kill)
    killer.start()
    with pytest.raises(ProcessError, match="was killed"):
        front_ends(open_inputs(data).robots, Config(), cache=StageCache(None), jobs=2, progress=NoProgress())
    killer.join()
    assert active_children() == []


def test_another_drift_model_holds_for_odometry_from_the_cache(tmp_path: Path) -> None:
    for walk in (0.05, 0.5):
        config = Config.model_validate({"drift": {"translation_walk": walk}})
        fronts, _ = front_ends([robot(SCANS)], config, cache=StageCache(tmp_path), jobs=1, progress=NoProgress())
        assert fronts["alpha"].keyframes.drift.translation_walk == walk


def test_processes_give_the_same_result(tmp_path: Path) -> None:
    """Three for two robots: one of them reads ahead, the other does not."""
    data = []
    for name in ("alpha", "beta"):
        write_kitti_folder(tmp_path / name, SCANS)
        data.append(f"{name}={tmp_path / name}")
    robots = open_inputs(data).robots
    alone, _ = front_ends(robots, Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    together, _ = front_ends(robots, Config(), cache=StageCache(None), jobs=3, progress=NoProgress())
    for name, front in alone.items():
        np.testing.assert_array_equal(together[name].odometry.poses, front.odometry.poses)
        np.testing.assert_array_equal(together[name].descriptors, front.descriptors)


# ------------------------------------------------------------------------------------------------ settings of one robot
def test_settings_of_a_robot_go_before_the_configurations() -> None:
    config = Config.model_validate({"odometry": {"max_range_m": 60, "voxel_size_m": 0.5}})
    alpha = replace(robot(SCANS), odometry_settings={"max_range_m": 30})
    assert odometry_settings(alpha, config).max_range_m == 30
    assert odometry_settings(alpha, config).voxel_size_m == 0.5
    assert odometry_settings(robot(SCANS), config).max_range_m == 60
    with pytest.raises(ConfigError, match=r"settings of robot alpha.*min_range_m 40"):
        odometry_settings(replace(alpha, odometry_settings={"min_range_m": 40, "max_range_m": 30}), config)


@pytest.mark.parametrize(
    ("configured", "of_robot", "expected"), [(None, {}, 0.205), (0.0, {}, 0.0), (0.1, {}, 0.1), (0.1, 0.3, 0.3)]
)
def test_a_recordings_need_counts_where_nothing_is_set(
    configured: float | None, of_robot: float | dict[str, float], expected: float
) -> None:
    config = Config.model_validate({"odometry": {"elevation_correction_deg": configured}})
    own = {"elevation_correction_deg": of_robot} if of_robot else {}
    kitti = replace(robot(SCANS), elevation_correction_deg=0.205, odometry_settings=own)
    assert odometry_settings(kitti, config).elevation_correction_deg == expected


def test_kittis_beams_are_turned_up_and_it_is_said(tmp_path: Path) -> None:
    write_kitti_folder(tmp_path / "08", SCANS)
    (kitti,) = open_inputs([f"alpha={tmp_path}/08"]).robots
    fronts, _ = front_ends([kitti], Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    assert "all beams are turned up by 0.205 degrees" in remarks(kitti, fronts["alpha"], Config())[0]
    plain = Config.model_validate({"odometry": {"elevation_correction_deg": 0}})
    level, _ = front_ends([kitti], plain, cache=StageCache(None), jobs=1, progress=NoProgress())
    assert remarks(kitti, level["alpha"], plain) == ()
    # Each point is lifted by 0.205 degrees of its distance; thinning takes other points, but as many here as there.
    lifted, flat = (np.concatenate(front["alpha"].clouds) for front in (fronts, level))
    expected = np.deg2rad(0.205) * np.hypot(*flat[:, :2].T).mean()
    assert lifted[:, 2].mean() - flat[:, 2].mean() == pytest.approx(expected, rel=0.5)


def test_scans_have_poses_at_their_own_stamps() -> None:
    """Sweeps begin at the stamp, poses belong to their ends: in between the motion goes on evenly."""
    way = Trajectory(
        "alpha", 10**9 + np.arange(-2, 30) * 5 * 10**7, se3.from_yaw(0.0, np.arange(-2, 30)[:, None] * [0.05, 0, 0])
    )
    times = np.linspace(0, 0.1, 2000)
    scans = [replace(scan, times=times) for scan in SCANS]
    moving = replace(robot(scans), odometry=way)
    fronts, _ = front_ends([moving], Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    front = fronts["alpha"]
    assert front.scans.stamps_ns.tolist() == [scan.stamp_ns for scan in scans]
    assert front.odometry.stamps_ns.tolist() == [scan.stamp_ns + 10**8 for scan in scans]
    np.testing.assert_allclose(front.scans.poses, way.at(front.scans.stamps_ns), atol=1e-9)


class Ending(Listed):
    """Scans whose reader dies before one of them, and counts those that it gave."""

    def __init__(self, scans: Sequence[Scan], before: int | None) -> None:
        super().__init__(scans, len(scans))
        self._before = before

    def __iter__(self) -> Iterator[Scan]:
        for number, scan in enumerate(self._scans):
            if number == self._before:
                raise InterruptedError("the worker is gone")
            yield scan


def test_odometry_goes_on_from_its_last_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checkpoints, "LEAST_S", 0.0)
    monkeypatch.setattr(checkpoints, "_REST", 0.0)
    settings = {"keyframes": {"distance_m": 1e-6, "scans": 2}}
    config, cache = Config.model_validate(settings), StageCache(tmp_path)
    registered: list[int] = []
    process = OdometryRun.process

    def counted(run: OdometryRun, scan: Scan) -> bool:
        registered.append(scan.stamp_ns)
        return process(run, scan)

    monkeypatch.setattr(OdometryRun, "process", counted)

    def odometry(before: int | None, kept: StageCache) -> FrontEndResult:
        scans = Ending(SCANS, before)
        one = RobotInput("alpha", scans, ["alpha"], None)
        return front_ends([one], config, cache=kept, jobs=1, progress=NoProgress())[0]["alpha"]

    whole = odometry(None, StageCache(None))
    registered.clear()
    with pytest.raises(InterruptedError):
        odometry(3, cache)
    assert [stock.stage for stock in cache.stock()] == ["checkpoint"]
    resumed = odometry(None, cache)
    assert registered == [scan.stamp_ns for scan in SCANS]  # each once
    assert resumed.odometry.poses.tobytes() == whole.odometry.poses.tobytes()
    assert [cloud.tobytes() for cloud in resumed.clouds] == [cloud.tobytes() for cloud in whole.clouds]
    assert resumed.counts == whole.counts
    assert "checkpoint" not in {stock.stage for stock in cache.stock()}


@pytest.mark.parametrize("damage", [{}, {"stamps_ns": np.zeros(3)}, {"stamps_ns": np.array([{}], object)}])
def test_a_damaged_checkpoint_begins_anew(tmp_path: Path, damage: dict[str, object]) -> None:
    def save(arrays: dict[str, object], path: Path) -> None:
        with path.open("wb") as file:
            np.savez(file, **arrays)

    StageCache(tmp_path).keep("checkpoint", "alpha", damage, save=save)
    begun = OdometryRun(OdometrySettings(), [KeyframeSettings()], "alpha")
    assert Checkpoints(StageCache(tmp_path), "alpha").resumed(lambda: begun) is begun
    assert not list(tmp_path.iterdir())
