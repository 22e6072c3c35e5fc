from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from wiclosure.errors import InputError, ProcessError
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.inputs import RobotInput
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.odometry import front_ends, left_out
from wiclosure.types import Scan


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
    assert left_out(source, fronts["alpha"]) == (
        "alpha: 1 of 6 scans have too few points in range and were skipped",
        "alpha: 2 of 6 scans have stamps that repeat or go back and were skipped",
        "alpha: only 6 of 7 announced scans could be read",
    )


def test_nothing_is_said_of_a_whole_recording() -> None:
    source = robot(SCANS)
    fronts, _ = front_ends([source], Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    assert left_out(source, fronts["alpha"]) == ()


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
        write_kitti_folder(tmp_path / name, [replace(SCANS[0], stamp_ns=k * 10**8) for k in range(2000)])
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


@pytest.mark.parametrize("jobs", [2, 3])
def test_processes_give_the_same_result(tmp_path: Path, jobs: int) -> None:
    """With three for two robots, one of them reads ahead."""
    data = []
    for name in ("alpha", "beta"):
        write_kitti_folder(tmp_path / name, SCANS)
        data.append(f"{name}={tmp_path / name}")
    robots = open_inputs(data).robots
    alone, _ = front_ends(robots, Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    together, _ = front_ends(robots, Config(), cache=StageCache(None), jobs=jobs, progress=NoProgress())
    for name, front in alone.items():
        np.testing.assert_array_equal(together[name].odometry.poses, front.odometry.poses)
        np.testing.assert_array_equal(together[name].descriptors, front.descriptors)
