"""Paths that inputs and command lines name: whatever stands there is a path, though perhaps of nothing."""

from __future__ import annotations

from pathlib import Path


def expanded(name: str | Path) -> Path:
    """The path, `~` as the home folder; as it is where no such user is known."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        return Path(name)


def exists(path: Path) -> bool:
    """Whether something lies there; under a name that no file can have, nothing does."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def is_file(path: Path) -> bool:
    """Whether it is a file; see `exists`."""
    return exists(path) and path.is_file()


def is_folder(path: Path) -> bool:
    """Whether it is a folder; see `exists`."""
    return exists(path) and path.is_dir()


def is_endless(path: Path) -> bool:
    """Whether it is a device, a pipe or a socket: what others' files name must end, and not wait for anybody."""
    return exists(path) and not path.is_file() and not path.is_dir()
