"""Which files a ROS bag consists of, and of what kind they are."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path, PurePath

from wiclosure.errors import InputError
from wiclosure.formats.structured_text import read_yaml
from wiclosure.formats.unpacking import unpack_file
from wiclosure.pipeline.sources.clouds.file_stamps import natural
from wiclosure.pipeline.sources.salvage.found import MCAP_MAGIC, ROS1_MAGIC
from wiclosure.scratch import temporary_folder

logger = logging.getLogger(__name__)

KINDS: Mapping[str, str] = {"ros1": "ROS 1 bag", "mcap": "ROS 2 bag (mcap)", "sqlite3": "ROS 2 bag (sqlite3)"}
_MAGIC = {ROS1_MAGIC: "ros1", MCAP_MAGIC: "mcap", b"SQLite format 3\0": "sqlite3"}
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
            return sorted(files, key=lambda file: natural(file.name))
    return []


def plain_files(path: Path, stack: ExitStack) -> list[Path]:
    """The bag's files, unpacked into a temporary folder where they are compressed as a whole.

    Args:
        path: file or folder.
        stack: deletes the temporary folder when it closes.

    Raises:
        InputError: a folder holds none of the files that its metadata names, or, without metadata, files of different
            names.
    """
    files = _files_of_folder(path) if path.is_dir() else [path]
    packed = [file for file in files if file.suffix == ".zstd"]
    if not packed:
        return files
    folder = stack.enter_context(temporary_folder())
    for file in packed:
        unpack_file(file, folder / file.stem)
    return [folder / file.stem if file.suffix == ".zstd" else file for file in files]


def _files_of_folder(folder: Path) -> list[Path]:
    """The storage files that metadata names, and others of their kind of name; all where it names none that is there.

    Metadata is stale where a recorder was killed or a file renamed.
    """
    files, listed = _storage_files(folder), _listed(folder)
    if not files:
        named = f" of the files that {METADATA} names ({', '.join(listed)})" if listed else " storage file"
        raise InputError(f"{folder} is missing all{named}; copy them there")
    here = [file for file in files if file.name in listed]
    if here:
        if gone := [name for name in listed if not (folder / name).is_file()]:
            logger.warning("%s: %s names files that are missing: %s", folder, METADATA, ", ".join(gone))
        stems = {_stem(file) for file in here}
        files = [file for file in files if file.name in listed or _stem(file) in stems]
    elif len({_stem(file) for file in files}) > 1:
        raise several_recordings(folder, files)
    return files


def is_listed(path: Path, files: Sequence[Path]) -> bool:
    """Whether metadata names all files as parts of one recording."""
    listed = _listed(path) if path.is_dir() else []
    return {file.name for file in files} <= {name.removesuffix(".zstd") for name in listed}


def _listed(folder: Path) -> list[str]:
    """Names of the storage files by `metadata.yaml`; none where it cannot be read."""
    try:
        content = read_yaml(folder / METADATA)
        return [PurePath(str(name)).name for name in content["rosbag2_bagfile_information"]["relative_file_paths"]]
    except (InputError, KeyError, TypeError) as error:
        if (folder / METADATA).is_file():
            logger.warning("%s cannot be read (%s); the storage files are taken as they are", folder / METADATA, error)
        return []


def _stem(file: Path) -> str:
    """What names of one recording's files have in common."""
    return re.sub(r"\d+", "", file.name.removesuffix(".zstd"))


def several_recordings(path: Path, files: Sequence[Path]) -> InputError:
    """The error for a folder whose files are not parts of one recording."""
    return InputError(
        f"{path} holds several recordings: {', '.join(file.name for file in files[:12])}; name one of them"
    )


def has_write_ahead_log(database: Path) -> bool:
    """Whether messages wait beside the database, which rosbags would not see."""
    log = database.with_name(f"{database.name}-wal")
    return log.is_file() and log.stat().st_size > 0
