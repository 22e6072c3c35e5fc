"""`wiclosure init`: what a folder holds becomes a data set file that is read, with guesses marked."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from wiclosure.errors import InputError
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline import cli
from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.data.folders.draft import GUESS, draft_dataset
from wiclosure.pipeline.data.folders.overview import overview, recording_overview
from wiclosure.pipeline.data.folders.survey import survey
from wiclosure.types import Scan, Trajectory, WirelessLog, WirelessMeasurement

START_NS = 1_700_000_000_000_000_000


def scans() -> list[Scan]:
    rng = np.random.default_rng(0)
    return [Scan(START_NS + i * 10**8, rng.normal(0, 9, (150, 3)).astype(np.float32).astype(float)) for i in range(4)]


def trajectory(robot: str) -> Trajectory:
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, 0, 3] = np.arange(4)
    return Trajectory(robot, START_NS + np.arange(4) * 10**8, poses)


def table(rows: list[tuple[int, int, float]], header: str = "time_ms,tag,anchor,distance_mm") -> str:
    lines = [f"{1_700_000_000_000 + 100 * i},{a},{b},{mm}" for i, (a, b, mm) in enumerate(rows)]
    return "\n".join([header, *lines]) + "\n"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    write_ros1_bag(folder / "alpha.bag", scans())
    write_ros2_bag(folder / "beta_bag", scans(), "/lidar")
    write_tum(folder / "alpha_gt.tum", trajectory("alpha"))
    write_tum(folder / "beta_odometry.txt", trajectory("beta"))
    write_tum(folder / "other.tum", trajectory("other"))
    (folder / "uwb.csv").write_text(table([(7, 12, 5000), (12, 7, 5100), (7, 12, 5200)]))
    (folder / "notes.md").write_text("hello")
    return folder


def content(folder: Path) -> dict:
    return yaml.safe_load(draft_dataset(folder, survey(folder)))


def test_bags_truth_and_radio_become_a_data_set(site: Path) -> None:
    text = draft_dataset(site, survey(site))
    (site / "dataset.yaml").write_text(text)
    dataset = load_dataset([str(site)])
    assert list(dataset.robots) == ["alpha", "beta"]
    assert dataset.robots["beta"].topic == "/lidar"
    assert dataset.robots["alpha"].ground_truth == site / "alpha_gt.tum"
    log = dataset.wireless_log()
    assert [(m.receiver, m.transmitter, m.range_m) for m in log.measurements] == [
        ("alpha", "beta", 5.0), ("beta", "alpha", 5.1), ("alpha", "beta", 5.2),
    ]  # fmt: skip
    assert "# odometry: beta_odometry.txt  # 4 poses (TUM), 0 s, 3 m: used in the place of KISS-ICP" in text
    assert f"# {GUESS}: robots: which robot carries which tag id" in text
    assert "# not used: notes.md" in text
    assert "# not used: other.tum" in text


def test_truth_as_euroc_writes_it(site: Path) -> None:
    rows = [f"{START_NS + i * 10**8},{i}.0,0.0,0.0,1.0,0.0,0.0,0.0" for i in range(4)]
    (site / "beta_gt.csv").write_text("\n".join(["#timestamp,px,py,pz,qw,qx,qy,qz", *rows]) + "\n")
    assert content(site)["robots"]["beta"]["ground_truth"] == "beta_gt.csv"


def test_robots_of_their_numbers_are_no_guess(tmp_path: Path) -> None:
    for robot in ("turtle02", "turtle03"):
        write_ros1_bag(tmp_path / f"{robot}.bag", scans())
    (tmp_path / "uwb.csv").write_text(table([(2, 3, 5000), (2, 9, 5100)]))
    assert content(tmp_path)["wireless"] == [
        {"path": "uwb.csv", "robots": {"2": "turtle02", "3": "turtle03"}, "anchors": ["9"]}
    ]


def test_ids_that_cannot_be_told_wait_for_names(site: Path) -> None:
    (site / "uwb.csv").write_text(table([(7, 12, 5000), (12, 9, 5100), (9, 7, 5200)]))
    text = draft_dataset(site, survey(site))
    assert "# - {path: uwb.csv, robots: {7: NAME, 9: NAME, 12: NAME}}  # 3 ids, 2 robots" in text
    (site / "dataset.yaml").write_text(text)
    assert load_dataset([str(site)]).wireless == ()


def test_millimetres_by_their_size_are_a_guess(site: Path) -> None:
    (site / "uwb.csv").write_text(table([(7, 12, 20534), (12, 7, 20600)], "t,from,to,range"))
    assert content(site)["wireless"][0]["unit"] == "mm"
    assert f"# {GUESS}: unit: the median range would be" in draft_dataset(site, survey(site))


def test_a_log_of_ours_and_folders_of_scans(tmp_path: Path) -> None:
    for robot in ("alpha", "beta"):
        write_kitti_folder(tmp_path / robot, scans())
    write_wireless_log(tmp_path / "w.jsonl", WirelessLog((WirelessMeasurement(START_NS, "alpha", "beta", 5.0, 0.5),)))
    assert content(tmp_path) == {
        "robots": {"alpha": {"scans": "alpha/"}, "beta": {"scans": "beta/"}},
        "wireless": ["w.jsonl"],
    }


def test_bags_of_several_robots_in_one_folder_below(tmp_path: Path) -> None:
    (tmp_path / "bags").mkdir()
    for robot in ("alpha", "beta"):
        write_ros1_bag(tmp_path / "bags" / f"{robot}.bag", scans())
    assert {robot: entry["scans"] for robot, entry in content(tmp_path)["robots"].items()} == {
        "alpha": "bags/alpha.bag",
        "beta": "bags/beta.bag",
    }


def test_a_folder_without_scans(tmp_path: Path) -> None:
    (tmp_path / "notes.md").write_text("hello")
    with pytest.raises(InputError, match=r"no recording with point clouds \(notes\.md"):
        draft_dataset(tmp_path, survey(tmp_path))
    with pytest.raises(InputError, match="no folder"):
        survey(tmp_path / "gone")


def test_the_overview_says_what_is_used_and_what_not(site: Path) -> None:
    before = {entry.path.name: entry.use for entry in overview(site)}
    assert set(before.values()) == {""}
    (site / "dataset.yaml").write_text(draft_dataset(site, survey(site)))
    assert {entry.path.name: entry.use for entry in overview(site / "dataset.yaml")} == {
        "alpha.bag": "scans of alpha",
        "alpha_gt.tum": "ground truth of alpha",
        "beta_bag": "scans of beta",
        "beta_odometry.txt": "",
        "dataset.yaml": "data set",
        "notes.md": "",
        "other.tum": "",
        "uwb.csv": "wireless",
    }
    assert overview(site / "alpha.bag") == []
    assert overview(site / "uwb.csv")[0].what.startswith("radio: table (stamp: time_ms")


def called(monkeypatch: pytest.MonkeyPatch, *words: str) -> object:
    monkeypatch.setattr(sys, "argv", ["wiclosure", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code


def test_init_never_overwrites_unasked(
    site: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(monkeypatch, "init", str(site)) == 0
    assert "1 line is a guess: look at it" in capsys.readouterr().out
    (site / "dataset.yaml").write_text("mine")
    assert called(monkeypatch, "init", str(site)) == 1
    assert "exists already" in capsys.readouterr().err
    assert (site / "dataset.yaml").read_text() == "mine"
    assert called(monkeypatch, "init", str(site), "--overwrite") == 0
    assert called(monkeypatch, "info", str(site)) == 0
    out = capsys.readouterr().out
    uses = [line.split("│")[-2].strip() for line in out.splitlines() if line.startswith("│")]
    assert "scans of alpha" in " ".join(uses)


def boreas_folder(folder: Path) -> None:
    folder.mkdir()
    rng = np.random.default_rng(1)
    for number in range(3):
        azimuth, reach = rng.uniform(-3, 3, 4000), rng.uniform(3, 40, 4000)
        rows = [reach * np.cos(azimuth), reach * np.sin(azimuth), rng.uniform(-2, 3, 4000), rng.uniform(0, 255, 4000)]
        rows += [rng.integers(0, 64, 4000), np.linspace(0, 0.1, 4000)]
        np.column_stack(rows).astype("<f4").tofile(folder / f"{1_700_000_000_000_000 + number * 100_000}.bin")


def test_records_of_another_layout_are_guessed_and_then_read(tmp_path: Path) -> None:
    boreas_folder(tmp_path / "gamma")
    text = draft_dataset(tmp_path, survey(tmp_path))
    assert f"layout: boreas  # {GUESS}" in text
    assert "not used" not in text
    (tmp_path / "dataset.yaml").write_text(text)
    assert load_dataset([str(tmp_path)]).robots["gamma"].layout == "boreas"


def test_two_lidars_of_one_robot_are_no_team(tmp_path: Path) -> None:
    for name, topics in {"alpha": ("/front/points", "/rear/points"), "team": ("/r1/points", "/r2/points")}.items():
        folder = tmp_path / name
        folder.mkdir()
        two_topics(folder / "a_bag", topics)
        robots = content(folder)["robots"]
        assert [entry["topic"] for entry in robots.values()] == list(topics[: 1 if name == "alpha" else 2])
        assert GUESS in "".join(draft_dataset(folder, survey(folder)).splitlines()[1:])


def two_topics(path: Path, topics: tuple[str, str]) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
    from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, typestore

    store = typestore("cdr")
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, POINT_CLOUD_TYPE, typestore=store)
            for scan in scans():
                writer.write(connection, scan.stamp_ns, store.serialize_cdr(encode_scan(scan, store), POINT_CLOUD_TYPE))


@pytest.mark.parametrize(("later_ns", "robots"), [(0, ["robot1", "robot2"]), (4 * 10**8, ["drive"])])
def test_bags_at_once_are_robots_and_bags_in_turn_are_parts(tmp_path: Path, later_ns: int, robots: list[str]) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    write_ros1_bag(folder / "robot1.bag", scans())
    write_ros1_bag(folder / "robot2.bag", [replace(scan, stamp_ns=scan.stamp_ns + later_ns) for scan in scans()])
    assert list(content(tmp_path)["robots"]) == robots


def test_a_log_with_more_ids_than_robots_waits_with_all_that_is_known(site: Path) -> None:
    (site / "uwb.csv").write_text(
        table([(7, 3, 5000), (12, 3, 5100), (7, 12, 5200), (3, 7, 5200)], "t_ms,tag,anchor,d")
    )
    text = draft_dataset(site, survey(site))
    assert "# - {path: uwb.csv, unit: mm, robots: {3: NAME, 7: NAME, 12: NAME}}" in text
    edited = text.replace("# - {path: uwb.csv", "- {path: uwb.csv").replace(
        "3: NAME, 7: NAME, 12: NAME", "7: alpha, 12: beta"
    )
    (site / "dataset.yaml").write_text(edited.replace("12: beta}", "12: beta}, anchors: [3]"))
    (source,) = load_dataset([str(site)]).wireless
    assert (source.unit, source.anchors) == ("mm", ("3",))


def test_what_is_known_of_a_bag_names_radio_that_is_not_used(data_dir: Path) -> None:
    found = recording_overview(data_dir / "uwb_team_bag")
    (note,) = [note for note in found.notes if "not used" in note]
    assert "4020 sensor_msgs/Range messages on /uwb/tof/n_{from}/n_{to}/distance are not used (28 topics" in note
