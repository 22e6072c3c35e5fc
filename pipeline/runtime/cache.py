"""Finished stages on disk, so that an interrupted or repeated run does not start from nothing.

A stage's result is one file named by a hash of all that it depends on: input files (path, size, time of change), the
settings that it uses, the code, and the versions of the libraries that compute it.  The least recently used entries are
dropped when the cache grows too large.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TypeVar

from wiclosure.errors import ConfigError, OutputError
from wiclosure.pipeline.runtime.output import whole_file
from wiclosure.pipeline.runtime.paths import is_file

logger = logging.getLogger(__name__)

_Value = TypeVar("_Value")

_ENTRY = re.compile(r"[a-z-]+-[0-9a-f]{24}")

_FRONT_END_CODE = ("wiclosure", "wiclosure.formats", "wiclosure.frontends", "wiclosure.pipeline.sources")
"""What turns recordings into front end results; of `wiclosure` only its own modules, for all else lies below it."""


_LIBRARIES = ("kiss-icp", "kiss-matcher", "small-gicp", "numpy", "rosbags", "open3d")


def default_cache_folder() -> Path:
    """`WICLOSURE_CACHE`, or `wiclosure` in the user's cache folder.

    Raises:
        ConfigError: the former is a file, or an address.
    """
    named = os.environ.get("WICLOSURE_CACHE")
    if named and "://" in named:
        raise ConfigError(f"WICLOSURE_CACHE is {named}, an address; mount it, and name the folder")
    if named and is_file(Path(named)):
        raise ConfigError(f"WICLOSURE_CACHE is {named}, a file; name a folder, or leave the cache out with --no-cache")
    if named:
        return Path(named).absolute()  # workers elsewhere may have another working folder
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "wiclosure"


def default_cache_limit() -> int:
    """`WICLOSURE_CACHE_GB`, or 4 GB, in bytes.

    Raises:
        ConfigError: it is no number, or negative.
    """
    text = os.environ.get("WICLOSURE_CACHE_GB", "4")
    try:
        gigabytes = float(text)
    except ValueError:
        gigabytes = -1.0
    if not 0 <= gigabytes < float("inf"):
        raise ConfigError(f"WICLOSURE_CACHE_GB is {text!r}; expected a size in gigabytes, for example 4")
    return int(gigabytes * 2**30)


@dataclass(frozen=True, slots=True)
class Stock:
    """What the cache holds of one stage."""

    stage: str
    entries: int
    size_bytes: int


class StageCache:
    """Files of finished stages.

    Args:
        folder: where they are kept; None keeps nothing.
        limit_bytes: the least recently used entries go when the sum of all exceeds this; None: `default_cache_limit`.
    """

    def __init__(self, folder: Path | None, limit_bytes: int | None = None) -> None:
        self.folder = folder
        self.limit_bytes = default_cache_limit() if limit_bytes is None else limit_bytes

    def reuse(
        self,
        stage: str,
        depends_on: object,
        *,
        load: Callable[[Path], _Value],
        save: Callable[[_Value, Path], None],
        compute: Callable[[], _Value],
    ) -> tuple[_Value, bool]:
        """The stage's value, and whether it came from the cache.

        A cache that cannot be read or written is never an error: the stage is computed.
        """
        found = self.find(stage, depends_on, load=load)
        if found is not None:
            return found, True
        value = compute()
        self.keep(stage, depends_on, value, save=save)
        return value, False

    def find(self, stage: str, depends_on: object, *, load: Callable[[Path], _Value]) -> _Value | None:
        """The stage's value of an earlier run, or None.  What cannot be read is thrown away."""
        entry = self._entry(stage, depends_on)
        if entry is None or not entry.is_file():
            return None
        try:
            value = load(entry)
        except Exception as error:  # whatever is wrong with a cached file: compute it again
            logger.warning("cached %s cannot be read (%s); it is computed again", entry, error)
            with suppress(OSError):  # a cache that others filled may be read-only
                entry.unlink(missing_ok=True)
            return None
        with suppress(OSError):
            os.utime(entry)
        logger.info("%s: taken from the cache", stage)
        return value

    def keep(self, stage: str, depends_on: object, value: _Value, *, save: Callable[[_Value, Path], None]) -> None:
        """Keeps the stage's value for later runs, in the place of an older one."""
        entry = self._entry(stage, depends_on)
        if entry is None:
            return
        try:
            entry.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            with whole_file(entry, mode=0o600) as scratch:
                save(value, scratch)
            self._trim()
        except (OutputError, OSError) as error:
            logger.warning("%s is not kept for later runs: %s", stage, error)

    def drop(self, stage: str, depends_on: object) -> None:
        """Throws one entry away, if it is there."""
        entry = self._entry(stage, depends_on)
        if entry is not None:
            with suppress(OSError):
                entry.unlink(missing_ok=True)

    def stock(self) -> tuple[Stock, ...]:
        """What is kept, by stage."""
        found: dict[str, list[int]] = {}
        for entry, status in self._entries():
            found.setdefault(entry.name.rpartition("-")[0], []).append(status.st_size)
        return tuple(Stock(stage, len(sizes), sum(sizes)) for stage, sizes in sorted(found.items()))

    def clear(self) -> None:
        """Throws all entries away, and nothing else that may lie in the folder."""
        for entry, _ in self._entries():
            entry.unlink(missing_ok=True)

    def _entry(self, stage: str, depends_on: object) -> Path | None:
        return None if self.folder is None else self.folder / f"{stage}-{_digest(stage, depends_on)}"

    def _entries(self) -> list[tuple[Path, os.stat_result]]:
        """Files that this class named; another process may be throwing some away meanwhile."""
        entries = []
        for path in self.folder.glob("*") if self.folder is not None else ():
            try:
                if _ENTRY.fullmatch(path.name) and path.is_file():
                    entries.append((path, path.stat()))
            except FileNotFoundError:
                continue
        return entries

    def _trim(self) -> None:
        total = 0
        for entry, status in sorted(self._entries(), key=lambda found: found[1].st_mtime, reverse=True):
            total += status.st_size
            if total > self.limit_bytes:
                entry.unlink(missing_ok=True)


def file_identity(path: Path) -> list[object]:
    """What tells a file or folder from its changed self: path, and size and time of change of every file in it."""
    path = path.resolve()
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    stats = [(str(f.relative_to(path)), f.stat().st_size, f.stat().st_mtime_ns) for f in files if f.is_file()]
    return [str(path), stats]


def _digest(stage: str, depends_on: object) -> str:
    libraries = {name: library_version(name) for name in _LIBRARIES}
    text = json.dumps([stage, depends_on, libraries, code_digest(_FRONT_END_CODE)], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def library_version(library: str) -> str:
    """The installed version; empty where it is not installed."""
    try:
        return version(library)
    except PackageNotFoundError:
        return ""


@cache
def code_digest(packages: tuple[str, ...]) -> str:
    """Of these packages' code, with what they hold inside: a mended bug must not live on in the cache."""
    digest = hashlib.sha256()
    for package in packages:
        for file in _modules(files(package), deep=package != "wiclosure"):
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _modules(folder: Traversable, *, deep: bool) -> Iterator[Traversable]:
    """The Python files of a package in order; of its sub-packages too, where deep."""
    for inside in sorted(folder.iterdir(), key=lambda f: f.name):
        if inside.name.endswith(".py"):
            yield inside
        elif deep and inside.is_dir():
            yield from _modules(inside, deep=True)
