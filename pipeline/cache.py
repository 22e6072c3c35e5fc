"""Finished stages on disk, so that an interrupted or repeated run does not start from nothing.

A stage's result is one file named by a hash of all that it depends on: input files (path, size, time of change),
settings, the code, and the versions of the libraries that compute it.  Old entries are dropped when the cache grows too
large.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

from wiclosure.errors import OutputError
from wiclosure.pipeline.output import whole_file

logger = logging.getLogger(__name__)

Value = TypeVar("Value")

_FRONT_END_CODE = ("wiclosure", "wiclosure.frontends", "wiclosure.pipeline.sources")
"""What turns recordings into front end results."""


def default_cache_folder() -> Path:
    """`WICLOSURE_CACHE`, or `wiclosure` in the user's cache folder."""
    named = os.environ.get("WICLOSURE_CACHE")
    if named:
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "wiclosure"


class StageCache:
    """Files of finished stages.

    Args:
        folder: where they are kept; None keeps nothing.
        limit_bytes: the least recently used entries go when the sum of all exceeds this.
    """

    def __init__(self, folder: Path | None, limit_bytes: int = 4 * 2**30) -> None:
        self.folder = folder
        self.limit_bytes = limit_bytes

    def reuse(
        self,
        stage: str,
        depends_on: object,
        *,
        load: Callable[[Path], Value],
        save: Callable[[Value, Path], None],
        compute: Callable[[], Value],
    ) -> tuple[Value, bool]:
        """The stage's value, and whether it came from the cache.

        A cache that cannot be read or written is never an error: the stage is computed.
        """
        if self.folder is None:
            return compute(), False
        entry = self.folder / f"{stage}-{_digest(stage, depends_on)}"
        if entry.is_file():
            try:
                value = load(entry)
                os.utime(entry)
            except Exception as error:  # whatever is wrong with a cached file: compute it again
                logger.warning("cached %s cannot be read (%s); it is computed again", entry, error)
                entry.unlink(missing_ok=True)
            else:
                logger.info("%s: taken from the cache", stage)
                return value, True
        value = compute()
        try:
            with whole_file(entry) as scratch:
                save(value, scratch)
            self._trim()
        except (OutputError, OSError) as error:
            logger.warning("%s is not kept for later runs: %s", stage, error)
        return value, False

    def _trim(self) -> None:
        assert self.folder is not None
        entries = sorted(
            (p for p in self.folder.iterdir() if p.is_file()), key=lambda p: p.stat().st_mtime, reverse=True
        )
        total = 0
        for entry in entries:
            total += entry.stat().st_size
            if total > self.limit_bytes:
                entry.unlink(missing_ok=True)


def file_identity(path: Path) -> list[object]:
    """What tells a file or folder from its changed self: path, and size and time of change of every file in it."""
    path = path.resolve()
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    stats = [(str(f.relative_to(path)), f.stat().st_size, f.stat().st_mtime_ns) for f in files if f.is_file()]
    return [str(path), stats]


def _digest(stage: str, depends_on: object) -> str:
    libraries = {name: version(name) for name in ("kiss-icp", "small-gicp", "numpy", "rosbags", "open3d")}
    text = json.dumps([stage, depends_on, libraries, code_digest(_FRONT_END_CODE)], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


@cache
def code_digest(packages: tuple[str, ...]) -> str:
    """Of these packages' code: a mended bug must not live on in the cache."""
    digest = hashlib.sha256()
    for package in packages:
        for file in sorted(files(package).iterdir(), key=lambda f: f.name):
            if file.name.endswith(".py"):
                digest.update(file.read_bytes())
    return digest.hexdigest()
