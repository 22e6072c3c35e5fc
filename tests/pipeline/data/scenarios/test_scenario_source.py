"""Simulated worlds as data: the same as what `simulate` writes, told apart by all that is chosen."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.cli import app
from wiclosure.pipeline.config import Config, load_config
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.data.scenarios.scenario_source import read_scenario_word, scenario_inputs
from wiclosure.pipeline.data.scenarios.scenario_writer import RECORDERS, write_scenario
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.run import candidate_filter, prepare, run_stages
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.simulation import Scenario, make_scenario
from wiclosure.simulation.world.motion import MotionSettings, drive

CONFIG = load_config("small-site", overrides=["odometry.num_threads=1"])


@pytest.fixture(scope="module")
def short_mission() -> Scenario:
    """Two robots that drive 4 m each on the demo's yard."""
    site = make_scenario("demo-site")
    quick = MotionSettings(speed_mps=2.0, acceleration_mps2=2.0)
    paths = {"alpha": [(-24.0, 14.5), (-20.0, 15.0)], "beta": [(-20.0, 16.5), (-24.0, 16.0)]}
    robots = {name: drive(np.array(path), site.scene.ground, quick) for name, path in paths.items()}
    return Scenario("short", site.scene, robots, site.lidar, site.radio)


@pytest.mark.parametrize("recording", list(RECORDERS))
def test_scans_are_those_that_simulate_writes(short_mission: Scenario, tmp_path: Path, recording: str) -> None:
    formats = dict.fromkeys(short_mission.robots, recording)
    dataset = write_scenario(short_mission, tmp_path, formats, progress=NoProgress())
    for robot in open_inputs([str(dataset)]).robots:
        streamed, truth = short_mission.scan_source(robot.robot), short_mission.ground_truth(robot.robot)
        assert len(robot.scans) == len(streamed)
        for written, cast in zip(robot.scans, streamed, strict=True):
            assert written.stamp_ns == cast.stamp_ns
            np.testing.assert_array_equal(written.points, cast.points)
            if recording != "kitti":  # which has no room for the points' times
                assert written.times is not None
                assert cast.times is not None
                np.testing.assert_allclose(written.times, cast.times, atol=1e-8)
        assert robot.ground_truth is not None
        np.testing.assert_allclose(robot.ground_truth.poses, truth.poses, atol=1e-9)


def test_radio_is_that_which_simulate_writes(short_mission: Scenario, tmp_path: Path) -> None:
    dataset = write_scenario(
        short_mission, tmp_path, dict.fromkeys(short_mission.robots, "ros1"), progress=NoProgress()
    )
    written, heard = open_inputs([str(dataset)]).wireless, short_mission.wireless()
    assert [m.stamp_ns for m in written.measurements] == [m.stamp_ns for m in heard.measurements]
    assert [m.range_m for m in written.measurements] == pytest.approx([m.range_m for m in heard.measurements])


def merged(inputs: Inputs, jobs: int = 1, config: Config = CONFIG) -> RunResult:
    prepared = prepare(inputs, config, cache=StageCache(None), jobs=jobs, progress=NoProgress())
    return run_stages(prepared, candidate_filter("none", inputs, config), progress=NoProgress())


@pytest.mark.slow
def test_a_run_is_that_of_what_simulate_writes(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="0"):
        app(["simulate", "demo-site", "--seed", "3", "--out", str(tmp_path / "data"), "--quiet"])
    written = merged(open_inputs([str(tmp_path / "data")], limit=40))
    streamed = merged(open_inputs(["scenario:demo-site,seed=3"], limit=40), jobs=2)
    for robot, trajectory in streamed.merged.items():
        np.testing.assert_allclose(trajectory.stamps_ns, written.merged[robot].stamps_ns, rtol=0, atol=100)
        np.testing.assert_allclose(trajectory.poses, written.merged[robot].poses, atol=1e-6)
    assert streamed.metrics["closures"] == written.metrics["closures"]
    assert streamed.inputs.wireless == written.inputs.wireless


def test_scans_can_be_cast_by_another_process() -> None:
    robot = scenario_inputs("demo-site", limit=2).robots[0]
    first = next(iter(robot.scans))  # a ray casting tree, which cannot be sent, is there now
    sent = pickle.loads(pickle.dumps(robot.scans))
    assert len(sent) == 2
    np.testing.assert_array_equal(next(iter(sent)).points, first.points)


def test_limit_cuts_every_robot() -> None:
    inputs = open_inputs(["scenario:static-mirror"], limit=3)
    assert [len(robot.scans) for robot in inputs.robots] == [3, 3]
    assert [len(list(robot.scans)) for robot in inputs.robots] == [3, 3]
    assert [len(robot.scans) for robot in open_inputs(["scenario:static-mirror"], limit=10**6).robots] == [
        len(robot.scans) for robot in scenario_inputs("static-mirror").robots
    ]


def identity(word: str, limit: int | None = None) -> str:
    return json.dumps([robot.identity for robot in open_inputs([word], limit=limit).robots])


def test_the_cache_tells_worlds_apart_but_not_radios() -> None:
    words = [
        "static-mirror",
        "demo-site",
        "static-mirror,seed=1",
        "static-mirror,lidar=hdl64",
        "static-mirror,robots=1",
    ]
    identities = [identity(f"scenario:{word}") for word in words] + [identity("scenario:static-mirror", limit=5)]
    assert len(set(identities)) == len(identities)
    assert identity("scenario:static-mirror") == identities[0] == identity("scenario:static-mirror,radio.every_s=5")


def test_a_seed_can_be_exchanged() -> None:
    name, settings = read_scenario_word("scenario:static-mirror,radio.every_s=7,seed=4")
    worlds = [scenario_inputs(name, settings.model_copy(update={"seed": seed}), limit=1) for seed in (4, 5)]
    assert worlds[0].wireless == open_inputs(["scenario:static-mirror,radio.every_s=7,seed=4"]).wireless
    assert worlds[0].wireless != worlds[1].wireless
    assert [len(world.wireless.measurements) for world in worlds] == [7, 7]


def test_single_fields_of_the_radio_are_replaced(tmp_path: Path) -> None:
    (tmp_path / "times.csv").write_text("start_s,end_s\n0,30\n")
    own = make_scenario("shell-space").radio
    _, settings = read_scenario_word(f"shell-space,radio.every_m=5,schedule={tmp_path / 'times.csv'}")
    radio = make_scenario("shell-space", settings).radio
    assert radio.every_m == 5
    assert [(window.start_s, window.end_s) for window in radio.schedule] == [(0, 30)]
    assert radio.model_dump(exclude={"every_m", "schedule"}) == own.model_dump(exclude={"every_m", "schedule"})


@pytest.mark.parametrize(
    ("word", "parts"),
    [
        ("scenario:", ["unknown scenario ''", "shell-space"]),
        ("scenario:shelspace", ["did you mean shell-space"]),
        ("scenario:city,sed=3", ["unknown configuration key sed in scenario:city", "did you mean seed"]),
        ("scenario:city,radio.evry_m=3", ["radio.evry_m", "did you mean radio.every_m"]),
        ("scenario:city,seed", ["scenario:city seed", "key.path=value"]),
        ("scenario:city,seed=-1", ["seed = -1", "greater than or equal to 0"]),
        ("scenario:city,lidar_range_sigma_m=-0.1", ["lidar_range_sigma_m = -0.1"]),
        ("scenario:city,robots=0", ["0 robots", "1 to 3"]),
        ("scenario:city,lidar=vlp", ["did you mean vlp"]),
    ],
)
def test_bad_words_name_what_is_wrong(word: str, parts: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        open_inputs([word])
    assert all(part in str(caught.value) for part in parts), caught.value


def test_a_scenario_stands_alone(tmp_path: Path) -> None:
    for more in (
        {"data": ["scenario:city", "alpha=a.bag"]},
        {"data": ["scenario:city"], "topic": "/points"},
        {"data": ["scenario:city"], "wireless": [tmp_path / "w.jsonl"]},
        {"data": ["scenario:city"], "salvage": True},
    ):
        with pytest.raises(ConfigError, match="a scenario stands alone"):
            open_inputs(**more)
