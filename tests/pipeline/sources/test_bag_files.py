from __future__ import annotations

import logging
from contextlib import ExitStack
from pathlib import Path

import pytest

from wiclosure.errors import InputError
from wiclosure.formats.unpacking import zstd
from wiclosure.pipeline.sources.bag_files import METADATA, bag_kind, has_write_ahead_log, is_listed, plain_files


def metadata(folder: Path, *names: str) -> None:
    listed = "".join(f"\n    - {name}" for name in names)
    (folder / METADATA).write_text(f"rosbag2_bagfile_information:\n  relative_file_paths:{listed}\n")


def files_of(path: Path) -> list[str]:
    with ExitStack() as stack:
        return [file.name for file in plain_files(path, stack)]


@pytest.mark.parametrize(
    ("name", "content", "kind"),
    [
        ("a.bin", b"#ROSBAG V2.0\n....", "ros1"),
        ("a.bag", b"\x89MCAP0\r\n", "mcap"),  # its bytes count, not its name
        ("a", b"SQLite format 3\0", "sqlite3"),
        ("a.bag", b"", "ros1"),
        ("a.bag.active", b"", "ros1"),
        ("a.mcap.zstd", b"whatever", "mcap"),
        ("a.bag", b"something else", None),
        ("a.txt", b"", None),
    ],
)
def test_files_are_told_by_their_first_bytes(tmp_path: Path, name: str, content: bytes, kind: str | None) -> None:
    (tmp_path / name).write_bytes(content)
    assert bag_kind(tmp_path / name) == kind


def test_folders_are_told_by_what_they_hold(tmp_path: Path) -> None:
    assert bag_kind(tmp_path) is None
    (tmp_path / METADATA).write_text("")
    assert bag_kind(tmp_path) == "mcap"
    (tmp_path / "a_0.db3").touch()
    assert bag_kind(tmp_path) == "sqlite3"


def test_files_come_in_natural_order_with_and_without_metadata(tmp_path: Path, caplog) -> None:
    for number in (10, 2, 1):
        (tmp_path / f"a_{number}.mcap").touch()
    assert files_of(tmp_path) == ["a_1.mcap", "a_2.mcap", "a_10.mcap"]
    metadata(tmp_path, "a_1.mcap", "a_3.mcap")
    with caplog.at_level(logging.WARNING):
        assert files_of(tmp_path) == ["a_1.mcap", "a_2.mcap", "a_10.mcap"]  # metadata is older than the files
    assert "names files that are missing: a_3.mcap" in caplog.text


def test_recordings_beside_each_other_are_not_parts_of_one(tmp_path: Path) -> None:
    for name in ("alpha.bag", "beta.bag"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"holds several recordings: alpha\.bag, beta\.bag; name one of them"):
        files_of(tmp_path)
    metadata(tmp_path, "alpha.bag")
    assert files_of(tmp_path) == ["alpha.bag"]


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    metadata(tmp_path, "sub/a_0.mcap")
    with pytest.raises(InputError, match=r"is missing all of the files that metadata\.yaml names \(a_0\.mcap\)"):
        files_of(tmp_path)


def test_damaged_metadata_is_said_and_does_not_stop(tmp_path: Path, caplog) -> None:
    (tmp_path / "a_0.db3").touch()
    (tmp_path / METADATA).write_text("rosbag2_bagfile_information: [")
    assert files_of(tmp_path) == ["a_0.db3"]
    assert "the storage files are taken as they are" in caplog.text


def test_packed_files_are_unpacked_while_they_are_read(tmp_path: Path) -> None:
    (tmp_path / "a_0.mcap.zstd").write_bytes(zstd.compress(b"content"))
    with ExitStack() as stack:
        (file,) = plain_files(tmp_path, stack)
        assert (file.name, file.read_bytes()) == ("a_0.mcap", b"content")
    assert not file.exists()
    metadata(tmp_path, "a_0.mcap.zstd")
    assert is_listed(tmp_path, [Path("a_0.mcap")])
    assert not is_listed(tmp_path, [Path("a_0.mcap"), Path("a_1.mcap")])


def test_a_write_ahead_log_counts_where_something_is_in_it(tmp_path: Path) -> None:
    database, log = tmp_path / "a.db3", tmp_path / "a.db3-wal"
    assert not has_write_ahead_log(database)
    log.touch()
    assert not has_write_ahead_log(database)
    log.write_bytes(b"1")
    assert has_write_ahead_log(database)
