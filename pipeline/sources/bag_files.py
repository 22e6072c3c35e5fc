"""Which files a ROS bag consists of, and of what kind they are."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.salvage import mcap as salvage_mcap
from wiclosure.pipeline.sources.salvage import ros1 as salvage_ros1
from wiclosure.pipeline.sources.salvage import zstd

KINDS: Mapping[str, str] = {"ros1": "ROS 1 bag", "mcap": "ROS 2 bag (mcap)", "sqlite3": "ROS 2 bag (sqlite3)"}
_MAGIC = {salvage_ros1.MAGIC: "ros1", salvage_mcap.MAGIC: "mcap", b"SQLite format 3\0": "sqlite3"}
_SUFFIXES = {".bag": "ros1", ".mcap": "mcap", ".db3": "sqlite3"}
METADATA = "metadata.yaml"


def bag_kind(path: Path) -> str | None:
    """`ros1`, `mcap` or `sqlite3` for a bag file or folder, None for anything else.

    Files are told by their first bytes; an empty or unreadable one by its name.
    """
    if path.is_dir():
        kinds = [_SUFFIXES[Path(file.name.removesuffix(".zstd")).suffix] for file in _storage_files(path)]
        return kinds[0] if kinds else ("mcap" if (path / METADATA).is_file() else None)
    name = path.name.removesuffix(".zstd").removesuffix(".active")
    if path.name.endswith(".zstd"):
        return _SUFFIXES.get(Path(name).suffix)
    with path.open("rb") as file:
        head = file.read(16)
    found = next((kind for magic, kind in _MAGIC.items() if head.startswith(magic)), None)
    return found or (_SUFFIXES.get(Path(name).suffix) if not head else None)


def _storage_files(folder: Path) -> list[Path]:
    """Bag files in a folder, of the kind that is there, in natural order (`_2` before `_10`)."""
    for suffix in (".mcap", ".db3", ".bag"):
        files = [*folder.glob(f"*{suffix}"), *folder.glob(f"*{suffix}.zstd")]
        if files:
            return sorted(files, key=_natural)
    return []


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part) if part.isdigit() else -1, part) for part in re.split(r"(\d+)", path.name)]


def plain_files(path: Path, stack: ExitStack) -> list[Path]:
    """The bag's files, unpacked into a temporary folder where they are compressed as a whole.

    Args:
        path: file or folder.
        stack: deletes the temporary folder when it closes.

    Raises:
        InputError: a folder without metadata holds files of different names.
    """
    files = _storage_files(path) if path.is_dir() else [path]
    if len({re.sub(r"\d+", "", file.name) for file in files}) > 1 and not (path / METADATA).is_file():
        raise several_recordings(path, files)
    packed = [file for file in files if file.suffix == ".zstd"]
    if not packed:
        return files
    folder = Path(stack.enter_context(TemporaryDirectory(prefix="wiclosure-bag-")))
    for file in packed:
        zstd.decompress_file(file, folder / file.stem)
    return [folder / file.stem if file.suffix == ".zstd" else file for file in files]


def several_recordings(path: Path, files: Sequence[Path]) -> InputError:
    """The error for a folder whose files are not parts of one recording."""
    return InputError(
        f"{path} holds several recordings: {', '.join(file.name for file in files[:12])}; name one of them"
    )


def is_foreign(kind: str, files: Sequence[Path]) -> bool:
    """Whether rosbags would refuse whole files for what wrote them."""
    starts = [file for file in files if kind == "mcap" and file.stat().st_size > 64]
    return bool(starts) and not all(map(salvage_mcap.is_ros2_profile, starts))


def has_write_ahead_log(database: Path) -> bool:
    """Whether messages wait beside the database, which rosbags would not see."""
    log = database.with_name(f"{database.name}-wal")
    return log.is_file() and log.stat().st_size > 0
