from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE
from wiclosure.pipeline.sources.scanned_bag import damaged, scanned_bag, survey_bag
from wiclosure.types import Scan


def file_of(bags: dict[str, Path], kind: str) -> Path:
    path = bags[kind]
    return path if path.is_file() else next(file for file in path.iterdir() if file.suffix in {".mcap", ".db3"})


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
@pytest.mark.parametrize("contents", [True, False])
def test_a_whole_bag_is_counted_and_has_no_damage(
    bags: dict[str, Path], scans: list[Scan], kind: str, contents: bool
) -> None:
    found = survey_bag(kind, [file_of(bags, kind)], contents=contents)
    assert {name: (topic.msgtype, topic.count) for name, topic in found.topics.items()} == {
        "/points": (POINT_CLOUD_TYPE, 6)
    }
    assert (found.count, found.unordered, found.damage) == (6, frozenset(), ())
    assert (found.start_ns, found.end_ns) == (scans[0].stamp_ns, scans[-1].stamp_ns)


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
def test_messages_come_with_the_time_of_their_reception(bags: dict[str, Path], scans: list[Scan], kind: str) -> None:
    files = [file_of(bags, kind)]
    bag = scanned_bag(bags[kind], kind, files, survey_bag(kind, files))
    assert [stamp_ns for stamp_ns, _ in bag.read("/points")] == [scan.stamp_ns for scan in scans]
    _, message = next(bag.messages("/points"))
    read = np.frombuffer(message.data, "<f4").reshape(300, -1)[:, :3]  # type: ignore[attr-defined]
    np.testing.assert_array_equal(read, scans[0].points)


def test_messages_out_of_order_are_put_in_order(bags: dict[str, Path], scans: list[Scan], tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    path.write_bytes(file_of(bags, "sqlite3").read_bytes())
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("UPDATE messages SET timestamp = ? WHERE id = 4", (scans[0].stamp_ns - 5,))
        connection.commit()
    found = survey_bag("sqlite3", [path])
    assert (found.unordered, found.start_ns) == ({"/points"}, scans[0].stamp_ns - 5)
    read = list(scanned_bag(path, "sqlite3", [path], found).read("/points"))
    in_file = list(scanned_bag(path, "sqlite3", [file_of(bags, "sqlite3")], found).read("/points"))
    order = [3, 0, 1, 2, 4, 5]
    assert [stamp_ns for stamp_ns, _ in read] == [scans[0].stamp_ns - 5] + [scans[k].stamp_ns for k in order[1:]]
    assert [raw for _, raw in read] == [in_file[k][1] for k in order]


def test_a_file_that_changes_is_read_again(bags: dict[str, Path], tmp_path: Path) -> None:
    path, content = tmp_path / "a.bag", file_of(bags, "ros1").read_bytes()
    path.write_bytes(content)
    assert survey_bag("ros1", [path]).count == 6
    path.write_bytes(content[: len(content) // 100])
    assert survey_bag("ros1", [path]).count == 0


def test_the_error_of_a_damaged_bag_says_what_could_be_saved(bags: dict[str, Path], tmp_path: Path) -> None:
    whole = file_of(bags, "ros1")
    says = str(damaged(whole, "ros1", [whole], "no\n index."))
    assert "has no index (no index): 6 messages can be read (6 on /points); add --salvage to use them" in says
    head = tmp_path / "head.bag"
    head.write_bytes(whole.read_bytes()[:40])
    assert "holds no whole message" in str(damaged(head, "ros1", [head], "cut"))
    with pytest.raises(InputError, match="holds no whole message, nothing can be salvaged"):
        scanned_bag(head, "ros1", [head], survey_bag("ros1", [head]))
