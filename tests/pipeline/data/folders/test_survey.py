from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.data.dataset_writer import write_ros1_bag
from wiclosure.pipeline.data.folders.survey import is_recording, survey, survey_file
from wiclosure.types import Scan, Trajectory

START_NS = 10**18


def write_bag(path: Path, start_ns: int = START_NS) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_ros1_bag(path, [Scan(start_ns + k * 10**8, np.ones((10, 3)) * (k + 1)) for k in range(3)])
    return path


@pytest.mark.parametrize(
    ("name", "text", "kind", "holds"),
    [
        ("log.jsonl", '{"format": "wireless"}\n', "radio", "wireless log (JSON Lines)"),
        ("a.pyfg", "VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1\nEDGE_RANGE 0 A0 B0 1 1\n", "radio", "factor graph"),
        ("b.pyfg", "VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1\n", "unknown", "factor graph without ranges"),
        ("uwb.csv", "time,range,remark\n1,2.5,x\n", "radio", "table (stamp: time, range: range)"),
        ("temperature.csv", "time,celsius\n1,20\n2,21\n", "unknown", "table of 2 columns: time, celsius"),
        ("eight.txt", "1 0 0 0 1 1 1 1\n2 0 0 0 1 1 1 1\n", "unknown", None),
        ("walk.txt", "1 0 0 0 0 0 0 1\n3 3 4 0 0 0 0 1\n", "trajectory", "2 poses (TUM), 2 s, 5 m"),
        ("dataset.yaml", "robots: {}\n", "data set", "robots and radio logs by name"),
        ("a.bag", "hello", "unknown", "by its first bytes no bag"),
        ("notes.md", "hello", "unknown", ".md: not read"),
        ("README", "hello", "unknown", "no ending: not read"),
    ],
)  # fmt: skip
def test_what_a_file_is_taken_for(tmp_path: Path, name: str, text: str, kind: str, holds: str | None) -> None:
    path = tmp_path / name
    path.write_text(text)
    found = survey_file(path)
    assert (found.path, found.kind) == (path, kind)
    assert holds is None or found.holds == holds


def test_a_folder_and_the_one_below_are_listed_by_name(tmp_path: Path) -> None:
    write_bag(tmp_path / "beta.bag")
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = np.arange(3)
    write_tum(tmp_path / "alpha.tum", Trajectory("alpha", START_NS + np.arange(3) * 10**9, poses))
    (tmp_path / ".hidden").write_text("x")
    deep = tmp_path / "more" / "deeper"
    deep.mkdir(parents=True)
    (deep / "unseen.csv").write_text("time,range\n1,2\n")
    (tmp_path / "more" / "times.txt").write_text("1\n2\n")  # part of a recording
    (tmp_path / "more" / "uwb.csv").write_text("time,range\n1,2\n")
    found = survey(tmp_path)
    assert [(each.path.name, each.kind) for each in found] == [
        ("alpha.tum", "trajectory"), ("beta.bag", "recording"), ("uwb.csv", "radio")
    ]  # fmt: skip
    assert found[1].recording is not None
    assert found[1].recording.count == 3


def test_a_recording_that_cannot_be_read_is_listed_with_the_reason(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag")
    path.write_bytes(path.read_bytes()[:-200])
    (found,) = survey(tmp_path)
    assert (found.kind, found.recording) == ("recording", None)
    assert found.holds.startswith("cannot be read: ")
    assert "--salvage" in found.holds
    (found,) = survey(tmp_path, salvage=True)
    assert found.recording is not None


@pytest.mark.parametrize(("names", "later_ns", "one"), [
    (("run_0.bag", "run_1.bag"), 10**10, True),
    (("run_0.bag", "run_1.bag"), 0, False),
    (("alpha.bag", "beta.bag"), 10**10, False),
])  # fmt: skip
def test_bags_are_parts_of_one_recording_by_name_and_time(
    tmp_path: Path, names: tuple[str, str], later_ns: int, one: bool
) -> None:
    for number, name in enumerate(names):
        write_bag(tmp_path / "bags" / name, START_NS + number * later_ns)
    assert is_recording(tmp_path / "bags") == one
    assert [found.path.name for found in survey(tmp_path)] == (["bags"] if one else list(names))


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere is no folder"):
        survey(tmp_path / "nowhere")


def test_a_file_that_cannot_be_read_is_listed_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "memory.csv").symlink_to("/proc/self/mem")  # opens, and fails to read
    (found,) = survey(tmp_path)
    assert (found.kind, found.holds) == ("unknown", "cannot be read: Input/output error")
