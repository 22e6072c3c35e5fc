"""What every scanner keeps to, on whole, cut and disturbed files of its kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE
from wiclosure.pipeline.sources.salvage.found import Damage
from wiclosure.pipeline.sources.scanned_bag import scan_file

KINDS = ["ros1", "mcap", "sqlite3"]
START_NS, COUNT = 1_700_000_000_000_000_000, 12


@pytest.mark.parametrize("kind", KINDS)
def test_a_whole_file_is_read_whole_and_without_complaint(recordings: dict[str, Path], kind: str) -> None:
    damage = Damage()
    messages = list(scan_file(recordings[kind], kind, damage))
    assert damage.found == []
    assert [message.stamp_ns for message in messages] == [START_NS + k * 10**8 for k in range(COUNT)]
    assert {message.topic.msgtype for message in messages} == {POINT_CLOUD_TYPE}
    assert all(len(message.data) > 400 * 12 for message in messages)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8, 0.99])
def test_of_a_cut_file_a_first_part_is_read_and_the_damage_is_taken_down(
    recordings: dict[str, Path], tmp_path: Path, kind: str, share: float
) -> None:
    whole = recordings[kind].read_bytes()
    path = tmp_path / recordings[kind].name
    path.write_bytes(whole[: int(share * len(whole))])
    damage = Damage()
    expected = list(scan_file(recordings[kind], kind, Damage()))
    found = list(scan_file(path, kind, damage))
    assert [m.stamp_ns for m in found] == [m.stamp_ns for m in expected[: len(found)]]
    # SQLite fills a page that the file ends within: the last message may have zeros at its end.
    certain = max(len(found) - 1, 0) if kind == "sqlite3" else len(found)
    assert [m.data for m in found[:certain]] == [m.data for m in expected[:certain]]
    assert damage.found
    if share >= 0.5 and kind == "ros1":  # mcap has its schemas in one chunk here, SQLite its tree anywhere
        assert len(found) > 0.6 * share * COUNT


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_raised_whatever_bytes_are_turned(recordings: dict[str, Path], tmp_path: Path, kind: str) -> None:
    rng = np.random.default_rng(0)
    path = tmp_path / recordings[kind].name
    for _ in range(40):
        content = np.frombuffer(recordings[kind].read_bytes(), np.uint8).copy()
        where = rng.integers(0, len(content), 20)
        content[where] = rng.integers(0, 256, 20)
        path.write_bytes(content.tobytes())
        assert len(list(scan_file(path, kind, Damage()))) <= COUNT


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_something_else_and_an_empty_one_hold_nothing(tmp_path: Path, kind: str) -> None:
    for content in (b"", b"a text that is no recording\n" * 20):
        (tmp_path / "a").write_bytes(content)
        damage = Damage()
        assert list(scan_file(tmp_path / "a", kind, damage)) == []
        assert damage.found or not content
