"""`dataset.yaml` alone; data sets as a whole are tested in test_dataset.py."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import yaml

from wiclosure.errors import InputError, OutputError
from wiclosure.pipeline.data.dataset_file import read_dataset_file, write_dataset
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.radio.source import RadioSource

POSE = (0.3, 0.0, 1.2, 0.0, 0.0, 0.0, 1.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("a.bag", "a.tum", "a_odom.tum", "b.bag", "radio.jsonl"):
        (tmp_path / name).touch()
    return tmp_path


def test_everything_that_can_be_said_of_a_robot_comes_back(folder: Path) -> None:
    robots = {
        "alpha": RobotRecording(
            folder / "a.bag", "/points", folder / "a.tum", -0.5, {"/uwb": "beta"}, folder / "a_odom.tum", None, POSE
        ),
        "beta": RobotRecording(folder / "b.bag", odometry_topic="/odom"),
    }
    write_dataset(folder / "dataset.yaml", robots, [RadioSource(path=folder / "radio.jsonl")])
    assert read_dataset_file(folder / "dataset.yaml") == (robots, (RadioSource(path=folder / "radio.jsonl"),))


def test_what_is_not_said_is_not_written_and_paths_below_are_relative(folder: Path, tmp_path: Path) -> None:
    inside = folder / "set"
    inside.mkdir()
    write_dataset(folder / "dataset.yaml", {"b": RobotRecording(folder / "b.bag")})
    assert yaml.safe_load((folder / "dataset.yaml").read_text()) == {"robots": {"b": {"scans": "b.bag"}}}
    write_dataset(inside / "dataset.yaml", {"b": RobotRecording(folder / "b.bag")})
    assert yaml.safe_load((inside / "dataset.yaml").read_text())["robots"]["b"]["scans"] == str(tmp_path / "b.bag")


def test_one_log_needs_no_list(folder: Path) -> None:
    (folder / "dataset.yaml").write_text("robots: {a: {scans: a.bag}}\nwireless: radio.jsonl\n")
    assert read_dataset_file(folder / "dataset.yaml")[1] == (RadioSource(path=folder / "radio.jsonl"),)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("odometry: a_odom.tum, odometry_topic: /odom", 'has "odometry" and "odometry_topic", .* no bag; name one'),
        ("lidar_pose: [1, 2, 3]", '"lidar_pose" of robot a is \\[1, 2, 3\\]; expected seven numbers'),
        ("lidar_pose: [0, 0, 0, 0, 0, 0, 0]", "its quaternion is zero"),
        ("lidar_pose: [0, 0, .inf, 0, 0, 0, 1]", "expected seven numbers"),
        ("ranges: {/uwb: 3}", "is 3; expected text"),
        ("ranges: /uwb", "is '/uwb'; expected keys with values"),
        ("ignored_radio: /uwb", r"is '/uwb'; expected a list of topics, as \[/uwb\]"),
    ],
)
def test_a_bad_value_is_named(folder: Path, entry: str, says: str) -> None:
    (folder / "dataset.yaml").write_text(f"robots: {{a: {{scans: a.bag, {entry}}}}}")
    with pytest.raises(InputError, match=says):
        read_dataset_file(folder / "dataset.yaml")


def test_a_recording_in_the_place_of_a_robots_keys_is_told_with_the_key(folder: Path) -> None:
    (folder / "dataset.yaml").write_text("robots: {a: a.bag}")
    with pytest.raises(InputError, match=r"robot a is 'a.bag'; expected keys with values, as a: \{scans: a.bag\}"):
        read_dataset_file(folder / "dataset.yaml")


def test_files_that_cannot_be_read_or_written_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read .*gone\.yaml"):
        read_dataset_file(tmp_path / "gone.yaml")
    with pytest.raises(OutputError, match=r"cannot write the data set .*nowhere"):
        write_dataset(tmp_path / "nowhere" / "dataset.yaml", {})


@pytest.mark.parametrize("key", ["scans", "odometry", "ground_truth", "imu", "wireless"])
@pytest.mark.parametrize("name", ["pipe", "/dev/zero"])
def test_what_never_ends_is_no_input(tmp_path: Path, key: str, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "a.bag").touch()
    keys = {"scans": "a.bag"} | ({key: name} if key != "wireless" else {})
    content = {"robots": {"alpha": keys}} | ({"wireless": [name]} if key == "wireless" else {})
    (tmp_path / "dataset.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=f"{name}, which is neither a file nor a folder; name one"):
        read_dataset_file(tmp_path / "dataset.yaml")


@pytest.mark.parametrize(("key", "value"), [("ranges", "{/uwb: b}"), ("ignored_radio", "[/uwb]")])
def test_topics_of_a_robot_without_a_bag_are_refused(folder: Path, key: str, value: str) -> None:
    (folder / "clouds").mkdir()
    (folder / "dataset.yaml").write_text(f"robots: {{a: {{scans: clouds, {key}: {value}}}}}")
    with pytest.raises(InputError, match=f'robot a has "{key}", topics of its bag, but clouds is no bag; leave it out'):
        read_dataset_file(folder / "dataset.yaml")
