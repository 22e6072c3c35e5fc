"""Unfinished files and folders: named by the process that writes them, and removed when that process is gone.

A process that is killed tidies nothing up.  What it leaves beside results, in the cache or among temporary files
carries its number and its start in its name: the next process that writes in the same place removes it.
"""

from __future__ import annotations

import os
import re
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path

UNFINISHED = ".unfinished"
REPLACED = ".replaced"
"""Suffix of folders that hold what a new result is about to take the place of."""

_NAME = re.compile(rf"\.wiclosure-([0-9a-f]{{8}})-(\d+)-(\d+)-\w+({re.escape(UNFINISHED)}|{re.escape(REPLACED)})")


def unfinished_folder(parent: Path, suffix: str = UNFINISHED) -> Path:
    """A new folder that nobody else can read; what dead processes left beside it is removed first."""
    remove_abandoned(parent)
    return Path(tempfile.mkdtemp(prefix=_prefix(), suffix=suffix, dir=parent))


def unfinished_file(parent: Path) -> Path:
    """A new empty file that nobody else can read; see `unfinished_folder`."""
    remove_abandoned(parent)
    handle, name = tempfile.mkstemp(prefix=_prefix(), suffix=UNFINISHED, dir=parent)
    os.close(handle)
    return Path(name)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder among the system's temporary files that vanishes in the end."""
    folder = unfinished_folder(Path(tempfile.gettempdir()))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_abandoned(parent: Path) -> None:
    """Removes what processes of this machine and user left in a folder and are gone; puts back what they had replaced.

    Links, and whatever has another name or another owner, stay; so does what cannot be removed.
    """
    with suppress(OSError), os.scandir(parent) as entries:
        left = [entry for entry in entries if _is_abandoned(entry)]
        for entry in left:
            path = Path(entry.path)
            if entry.name.endswith(REPLACED):
                _put_back(path)
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _is_abandoned(entry: os.DirEntry[str]) -> bool:
    match = _NAME.fullmatch(entry.name)
    if match is None or entry.is_symlink() or match[1] != _machine():
        return False
    if hasattr(os, "getuid") and entry.stat(follow_symlinks=False).st_uid != os.getuid():
        return False
    pid, start = int(match[2]), match[3]
    return not _is_running(pid) or _start_of(pid) != start


def _put_back(folder: Path) -> None:
    """What was to be replaced, if its replacement never came."""
    for inside in folder.iterdir():
        with suppress(OSError):
            if not (folder.parent / inside.name).exists():
                inside.rename(folder.parent / inside.name)


@cache
def _prefix_of(pid: int) -> str:
    return f".wiclosure-{_machine()}-{pid}-{_start_of(pid)}-"


def _prefix() -> str:
    return _prefix_of(os.getpid())


@cache
def _machine() -> str:
    """The machine, and the numbering of processes: a container's is its own."""
    try:
        numbering = str(Path("/proc/self/ns/pid").stat().st_ino)
    except OSError:
        numbering = ""
    return sha256(f"{socket.gethostname()} {numbering}".encode()).hexdigest()[:8]


def _is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


def _start_of(pid: int) -> str:
    """When a process began, in ticks since the system did: numbers of processes come again; 0 where nothing tells."""
    try:
        status = Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return "0"
    return status.rpartition(b")")[2].split()[19].decode()
