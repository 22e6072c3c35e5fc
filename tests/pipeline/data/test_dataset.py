"""Data sets: the file, recordings named on the command line, ground truth, clocks, and one line for every problem."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.trajectories.kitti_poses import write_kitti_poses
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.data.dataset import Dataset, load_dataset
from wiclosure.pipeline.data.dataset_file import write_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.radio.words import sources_of_words
from wiclosure.pipeline.sources.bags import topic_names
from wiclosure.pipeline.sources.messages.ros_types import typestore
from wiclosure.pipeline.sources.messages.wireless_messages import encode_header
from wiclosure.pipeline.sources.wireless_topics import RANGE_TYPE
from wiclosure.types import Heading, Scan, Trajectory, WirelessLog, WirelessMeasurement

START_NS = 1_700_000_000_000_000_000
LOG = WirelessLog(
    (
        WirelessMeasurement(START_NS + 10, "alpha", "beta", 5.0, 0.5, transmitter_stamp_ns=START_NS + 12),
        WirelessMeasurement(START_NS + 300_000_000, "beta", "alpha", 6.0, 0.5),
    ),
    (Heading(START_NS + 20, "beta", 0.5, 0.05),),
)


def scans() -> list[Scan]:
    rng = np.random.default_rng(0)
    return [Scan(START_NS + i * 10**8, rng.normal(0, 9, (50, 3)).astype(np.float32).astype(float)) for i in range(5)]


def poses(count: int = 5) -> np.ndarray:
    rng = np.random.default_rng(1)
    return se3.from_rotation_translation(Rotation.random(count, rng=rng).as_matrix(), rng.normal(0, 50, (count, 3)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data set")
    write_ros1_bag(folder / "alpha.bag", scans(), wireless=LOG)
    write_ros2_bag(folder / "beta_bag", scans(), "/lidar", wireless=LOG)
    write_kitti_folder(folder / "gamma", scans(), T_world_lidar=poses())
    stamps = np.array([scan.stamp_ns for scan in scans()])
    write_tum(folder / "alpha_gt.tum", Trajectory("alpha", stamps, poses()))
    write_tum(folder / "late_gt.tum", Trajectory("alpha", stamps + 10**12, poses()))
    write_wireless_log(folder / "wireless.jsonl", LOG)
    write_wireless_log(
        folder / "foreign.jsonl", WirelessLog((WirelessMeasurement(START_NS, "alpha", "betta", 5.0, 0.5),))
    )
    return folder


GOOD = """\
robots:
  alpha: {scans: alpha.bag, topic: /points, ground_truth: alpha_gt.tum, time_offset: 0.0}
  beta:  {scans: beta_bag/}
wireless: [wireless.jsonl]
"""


def written(folder: Path, text: str, name: str = "dataset.yaml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def test_a_data_set_file(folder: Path) -> None:
    dataset = load_dataset([str(written(folder, GOOD))])
    assert list(dataset.robots) == ["alpha", "beta"]
    assert [len(dataset.scans(robot)) for robot in dataset.robots] == [5, 5]
    assert dataset.robots["alpha"].topic == "/points"
    truth = dataset.ground_truth("alpha")
    assert truth is not None
    np.testing.assert_allclose(truth.poses, poses(), atol=1e-12)
    assert dataset.ground_truth("beta") is None
    assert load_dataset([str(folder)]).robots == dataset.robots


def test_what_several_logs_repeat_counts_once(folder: Path) -> None:
    assert load_dataset([str(written(folder, GOOD))]).wireless_log() == LOG


def test_recordings_named_on_the_command_line(folder: Path) -> None:
    dataset = load_dataset(
        [f"alpha={folder}/alpha.bag", f"beta={folder}/beta_bag"],
        topic="/points",
        wireless=[RadioSource(path=folder / "wireless.jsonl")],
    )
    assert dataset.wireless_log() == LOG
    assert len(dataset.scans("alpha", limit=2)) == 2
    with pytest.raises(InputError, match=r"robot beta: .*no topic /points.*/lidar"):
        dataset.scans("beta")
    assert list(load_dataset([f"{folder}/alpha.bag", f"{folder}/gamma/"]).robots) == ["alpha", "gamma"]


def test_recordings_named_from_here_are_found_by_workers_elsewhere(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    sources = [load_dataset([f"alpha={name}"]).scans("alpha") for name in ("alpha.bag", "beta_bag", "gamma")]
    monkeypatch.chdir(tmp_path)
    assert [len(list(source)) for source in sources] == [5, 5, 5]


def test_scans_that_stand_twice_are_told(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_kitti_folder(folder / "08", [Scan(10**9, np.ones((5, 3)))])
    load_dataset([f"a={folder / '08'}"])
    assert not caplog.records
    load_dataset([f"a={folder / '08'}", f"b={folder / '..' / folder.name / '08'}"])
    assert "a and b have the same scans, " in caplog.text


def test_a_file_that_is_written_is_read_alike(folder: Path, tmp_path: Path) -> None:
    robots = {
        "alpha": RobotRecording(folder / "alpha.bag", "/points", folder / "alpha_gt.tum", -0.25),
        "beta": RobotRecording(folder / "beta_bag", ranges={"/uwb": "alpha"}),
    }
    dataset = Dataset(robots, (RadioSource(path=folder / "wireless.jsonl"),))
    for place in (folder / "again.yaml", tmp_path / "elsewhere.yaml"):
        write_dataset(place, dataset.robots, dataset.wireless)
        assert load_dataset([str(place)]) == dataset
    assert str(folder) not in (folder / "again.yaml").read_text()


def test_clocks_are_set_right(folder: Path) -> None:
    dataset = load_dataset([f"alpha={folder}/alpha.bag", f"beta={folder}/beta_bag"])
    robots = {
        robot: replace(r, time_offset=offset)
        for (robot, r), offset in zip(dataset.robots.items(), (1.0, -2.0), strict=True)
    }
    robots["alpha"] = replace(robots["alpha"], ground_truth=folder / "alpha_gt.tum")
    shifted = Dataset(robots)
    log = shifted.wireless_log()
    assert [(m.receiver, m.stamp_ns - START_NS, m.transmitter_stamp_ns) for m in log.measurements] == [
        ("beta", 300_000_000 - 2 * 10**9, None),
        ("alpha", 10 + 10**9, START_NS + 12 - 2 * 10**9),
    ]
    assert log.headings[0].stamp_ns == START_NS + 20 - 2 * 10**9
    assert next(iter(shifted.scans("alpha"))).stamp_ns == START_NS + 10**9
    truth = shifted.ground_truth("alpha")
    assert truth is not None
    assert truth.stamps_ns[0] == START_NS + 10**9


def test_ranges_of_a_driver_in_the_bag(folder: Path) -> None:
    store = typestore("ros1")
    with Writer(folder / "ranging.bag") as writer:
        connection = writer.add_connection("/uwb_2", RANGE_TYPE, typestore=store)
        message = store.types[RANGE_TYPE](
            header=encode_header(START_NS + 5, store, "antenna"),
            radiation_type=0, field_of_view=0.0, min_range=0.0, max_range=50.0, range=7.5,
        )  # fmt: skip
        writer.write(connection, START_NS, store.serialize_ros1(message, RANGE_TYPE))
    text = "robots: {alpha: {scans: ranging.bag, ranges: {/uwb_2: beta}}, beta: {scans: beta_bag}}"
    dataset = load_dataset([str(written(folder, text, "ranging.yaml"))])
    (measurement,) = (m for m in dataset.wireless_log().measurements if m not in LOG.measurements)
    assert (measurement.receiver, measurement.transmitter, measurement.range_m) == ("alpha", "beta", 7.5)


def test_radio_of_a_bag_may_be_left_out(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    own = ", ".join(set(topic_names(folder / "alpha.bag")) - {"/points"})
    text = f"robots: {{alpha: {{scans: alpha.bag, ignored_radio: [{own}]}}, gamma: {{scans: gamma}}}}"
    dataset = load_dataset([str(written(folder, text, "ignored.yaml"))])
    with caplog.at_level("WARNING", "wiclosure"):
        assert dataset.wireless_log() == WirelessLog()
    assert not caplog.records
    write_dataset(folder / "ignored_again.yaml", dataset.robots)
    assert load_dataset([str(folder / "ignored_again.yaml")]).robots == dataset.robots


def test_a_topic_of_each_robots_own_bag(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    for number, robot in enumerate(("one", "two")):
        store = typestore("ros1")
        with Writer(folder / f"{robot}.bag") as writer:
            connection = writer.add_connection("/uwb", RANGE_TYPE, typestore=store)
            message = store.types[RANGE_TYPE](
                header=encode_header(START_NS + number, store, f"uwb_{robot}"),
                radiation_type=0, field_of_view=0.0, min_range=0.0, max_range=50.0, range=7.0 + number,
            )  # fmt: skip
            writer.write(connection, START_NS, store.serialize_ros1(message, RANGE_TYPE))
    robots = "robots: {one: {scans: one.bag}, two: {scans: two.bag}}\n"
    dataset = load_dataset([str(written(folder, robots, "none.yaml"))])
    with caplog.at_level("WARNING", "wiclosure"):
        assert dataset.wireless_log().measurements == ()
    assert [
        "frame_id 'uwb_one' names no pair of robots; if it is a radio's, add ranges: {/uwb: two}" in caplog.text,
        "frame_id 'uwb_two' names no pair of robots; if it is a radio's, add ranges: {/uwb: one}" in caplog.text,
    ] == [True, True]
    caplog.clear()
    both = robots + "wireless: [{topic: /uwb, transmitter: two}]\n"
    dataset = load_dataset(
        [str(written(folder, both.replace("two: {scans: two.bag}", "two: {scans: gamma}"), "a.yaml"))]
    )
    (measurement,) = (m for m in dataset.wireless_log().measurements if m.receiver == "one")
    assert (measurement.transmitter, measurement.range_m) == ("two", 7.0)
    gone = load_dataset([str(written(folder, robots + "wireless: [{topic: /gone}]\n", "gone.yaml"))])
    with pytest.raises(InputError, match="no robot's bag has the topic /gone"):
        gone.wireless_log()


# ------------------------------------------------------------------------------------------------------- ground truth
def test_kitti_poses_are_ground_truth(folder: Path) -> None:
    truth = load_dataset([f"gamma={folder}/gamma"]).ground_truth("gamma")
    assert truth is not None
    np.testing.assert_allclose(truth.poses, poses(), atol=1e-12)
    assert truth.stamps_ns.tolist() == [scan.stamp_ns for scan in scans()]


def test_poses_of_the_camera_become_those_of_the_lidar(tmp_path: Path) -> None:
    T_camera_lidar = se3.from_rotation_translation(
        np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0.1, -0.2, -0.3])
    )
    T_world_camera = T_camera_lidar @ poses() @ se3.inverse(T_camera_lidar)
    sequence = tmp_path / "dataset" / "sequences" / "08"
    write_kitti_folder(sequence, scans())
    (sequence / "calib.txt").write_text(
        "P0: " + "0 " * 12 + "\nTr: " + " ".join(map(repr, T_camera_lidar[:3].reshape(-1).tolist())) + "\n"
    )
    (tmp_path / "dataset" / "poses").mkdir()
    write_kitti_poses(tmp_path / "dataset" / "poses" / "08.txt", T_world_camera)
    truth = load_dataset([f"a={sequence}"]).ground_truth("a")
    assert truth is not None
    np.testing.assert_allclose(truth.poses, poses(), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 2 3\n", "line 1: expected 12 numbers"),
        ("1 " * 12 + "\n", "line 1: not a pose"),
        ("1 0 0 5 0 1 0 5 0 0 1 5\n", "1 poses for 5 scans"),
    ],
)
def test_bad_kitti_poses(tmp_path: Path, text: str, says: str) -> None:
    write_kitti_folder(tmp_path / "g", scans())
    (tmp_path / "g" / "poses.txt").write_text(text)
    with pytest.raises(InputError, match=says):
        load_dataset([f"g={tmp_path}/g"]).ground_truth("g")


@pytest.mark.parametrize("recording", ["alpha.bag", "beta_bag", "gamma", "gamma/velodyne"])
def test_ground_truth_of_another_time(folder: Path, recording: str) -> None:
    dataset = Dataset({"a": RobotRecording(folder / recording, None, folder / "late_gt.tum")})
    with pytest.raises(InputError, match=r"late_gt\.tum of a covers .* do not overlap"):
        dataset.ground_truth("a")


# ---------------------------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("text", "says"),
    [
        (GOOD.replace("topic:", "topik:"), r"robot alpha has the unknown key 'topik'; did you mean topic"),
        (GOOD.replace("wireless:", "wireles:"), "unknown key 'wireles'; did you mean wireless"),
        (GOOD.replace("beta: ", "alpha:"), r"line 3: 'alpha' stands twice"),
        (GOOD.replace("alpha.bag", "gone.bag"), "robot alpha names .*gone.bag, which does not exist"),
        (GOOD.replace("topic: /points", "layout: x y"), "layout 'x y' is not known"),
        (GOOD.replace("topic: /points", "layout: x y z t:u3"), "'t:u3' has an unknown type"),
        (GOOD.replace("topic: /points", "odometry_settings: {max_rnge_m: 3}"), "did you mean max_range_m"),
        (GOOD.replace("topic: /points", "odometry_settings: {max_range_m: -3}"), "max_range_m: Input should"),
        (GOOD.replace("[wireless", "[gone"), "wireless log names .*gone.jsonl, which does not exist"),
        (GOOD.replace("time_offset: 0.0", "time_offset: soon"), '"time_offset" of robot alpha is \'soon\''),
        (GOOD.replace("time_offset: 0.0", "time_offset: .nan"), '"time_offset" of robot alpha is nan'),
        (GOOD.replace("time_offset: 0.0", "time_offset: true"), '"time_offset" of robot alpha is True'),
        (GOOD.replace("topic: /points", "topic: [a]"), '"topic" of robot alpha is'),
        (GOOD.replace("{scans: beta_bag/}", "beta_bag"), "robot beta is 'beta_bag'"),
        (GOOD.replace("{scans: beta_bag/}", "{topic: /p}"), 'robot beta has no "scans"'),
        (GOOD.replace("[wireless.jsonl]", "{a: b}"), "wireless source with unknown key 'a'"),
        (GOOD.replace("[wireless.jsonl]", "{path: wireless.jsonl, unit: miles}"), "unit is 'miles'"),
        (GOOD.replace("[wireless.jsonl]", "{preset: milv, path: wireless.jsonl}"), "did you mean miluv"),
        (GOOD.replace("[wireless.jsonl]", "3"), "a wireless source is '3'"),
        (GOOD.replace("alpha:", "7:"), "a robot's name is 7"),
        (GOOD.replace("alpha:", "al/pha:"), "robot name 'al/pha' cannot be used"),
        (GOOD.replace("alpha:", "team:"), "robot name 'team' cannot be used"),
        (GOOD.replace("alpha:", "beta_odometry:"), "robot names 'beta' and 'beta_odometry' cannot stand together"),
        (GOOD.replace("alpha:", "beta_ground_truth:"), "'beta' and 'beta_ground_truth'.*rename"),
        ("robots: {}", "names no robots"),
        ("wireless: []", 'has no "robots"'),
        ("", "the file is empty"),
        ("- a", "the file is"),
        ("robots: {alpha: [", "line [12]"),
        ("{[a]: b}", "line 1"),
        ("a: !!python/object:os.system {}", "could not determine a constructor"),
    ],
)  # fmt: skip
def test_a_bad_file_is_one_line(folder: Path, text: str, says: str) -> None:
    path = written(folder, text, "bad.yaml")
    with pytest.raises(InputError, match=says) as caught:
        load_dataset([str(path)])
    assert "\n" not in str(caught.value)
    assert "bad.yaml" in str(caught.value) or "robot name" in str(caught.value)


def test_bad_arguments_are_one_line(folder: Path) -> None:
    bag = f"{folder}/alpha.bag"
    with pytest.raises(ConfigError, match="no data given"):
        load_dataset([])
    with pytest.raises(InputError, match="two robots are named a"):
        load_dataset([f"a={bag}", f"a={folder}/beta_bag"])
    with pytest.raises(InputError, match=r"gone\.bag of robot a does not exist"):
        load_dataset(["a=gone.bag"])
    with pytest.raises(InputError, match=r"gone\.yaml"):
        load_dataset(["gone.yaml"])
    with pytest.raises(InputError, match="stands beside other data"):
        load_dataset([str(written(folder, GOOD)), f"a={bag}"])
    with pytest.raises(InputError, match=r"wireless log .*gone\.jsonl"):
        load_dataset([f"a={bag}"], wireless=sources_of_words(["gone.jsonl"]))


def test_an_unknown_robot_in_the_wireless_log(folder: Path) -> None:
    dataset = load_dataset(
        [f"alpha={folder}/alpha.bag", f"beta={folder}/beta_bag"], wireless=[RadioSource(path=folder / "foreign.jsonl")]
    )
    with pytest.raises(InputError, match=r"foreign\.jsonl mentions the robot 'betta'.*alpha, beta.*did you mean beta"):
        dataset.wireless_log()


def test_a_robot_mapped_alone_leaves_its_radio_to_others_aside(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert not load_dataset([f"alpha={folder}/alpha.bag"]).wireless_log().measurements
    assert "its radio heard beta, of which no recording is given; it is not used" in caplog.text


def test_the_topic_of_all_bags_is_none_of_a_folder_of_clouds(folder: Path) -> None:
    (folder / "clouds").mkdir()
    (folder / "clouds" / "1.pcd").write_text("")
    both = load_dataset([f"alpha={folder / 'alpha.bag'}", f"beta={folder / 'clouds'}"], topic="/points")
    assert [recording.topic for recording in both.robots.values()] == ["/points", None]
