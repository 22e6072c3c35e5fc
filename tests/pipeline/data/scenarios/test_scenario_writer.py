"""Scenarios on disk; that their scans are those of the stream is tested in test_scenario_source.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from wiclosure.errors import ConfigError
from wiclosure.formats.trajectories.tum import read_tum
from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.data.scenarios.scenario_writer import RECORDERS, require_format, write_scenario
from wiclosure.pipeline.runtime.processes import Processes
from wiclosure.pipeline.runtime.progress import CallbackProgress, NoProgress
from wiclosure.simulation.scenario import Scenario
from wiclosure.simulation.scenarios.registry import ScenarioSettings, make_scenario
from wiclosure.workers import ThisProcess


@pytest.fixture
def short() -> Scenario:
    """A robot that hardly moves: few scans."""
    made = make_scenario("static-mirror", ScenarioSettings(lidar="generic-32"))
    return replace(made, lidar=replace(made.lidar, rate_hz=0.2))


def test_a_data_set_as_a_user_would_bring_it(short: Scenario, tmp_path: Path) -> None:
    formats = dict(zip(short.robots, ("ros1", "kitti"), strict=True))
    file = write_scenario(short, tmp_path, formats, progress=NoProgress())
    dataset = load_dataset([str(file)])
    assert [recording.scans.name for recording in dataset.robots.values()] == ["alpha.bag", "beta"]
    assert dataset.wireless_log() == short.wireless()
    for robot in short.robots:
        assert len(dataset.scans(robot)) == len(short.scan_source(robot))
        written = read_tum(tmp_path / f"{robot}_gt.tum", robot)
        assert written.stamps_ns.tolist() == short.ground_truth(robot).stamps_ns.tolist()


def test_processes_write_the_same(short: Scenario, tmp_path: Path) -> None:
    formats, shown = dict(zip(short.robots, ("ros1", "kitti"), strict=True)), list[tuple[str, int, int | None]]()
    for name, workers in (("here", ThisProcess()), ("there", Processes(2))):
        (tmp_path / name).mkdir()
        progress = CallbackProgress(lambda *told: shown.append(told))
        write_scenario(short, tmp_path / name, formats, progress=progress, workers=workers)
    here, there = (
        {
            path.relative_to(tmp_path / name): path.read_bytes()
            for path in (tmp_path / name).rglob("*")
            if path.is_file()
        }
        for name in ("here", "there")
    )
    assert here == there
    count = {robot: len(short.scan_source(robot)) for robot in short.robots}
    assert {(f"simulating {robot}", scans, scans) for robot, scans in count.items()} <= set(shown)


def test_an_unknown_format_is_refused_before_anything_is_written(short: Scenario, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="unknown recording format 'ros3'; choose one of ros1, ros2-mcap"):
        write_scenario(short, tmp_path, dict.fromkeys(short.robots, "ros3"), progress=NoProgress())
    assert list(tmp_path.iterdir()) == []
    for name in RECORDERS:
        require_format(name)
