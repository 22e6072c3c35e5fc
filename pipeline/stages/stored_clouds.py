"""Keyframe clouds of one robot in the stage cache, where the workers of a cluster find them by their key."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from wiclosure.errors import ConfigError
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.types import Float32Array

_STAGE = "clouds"
_MOST_ROBOTS = 16  # whose clouds a worker holds at a time


@dataclass(frozen=True, slots=True)
class StoredClouds:
    """Where the clouds of a robot lie.

    Args:
        robot: its name.
        folder: of the cache.
        digest: of the clouds.
    """

    robot: str
    folder: Path
    digest: str

    @classmethod
    def of(cls, robot: str, clouds: Sequence[Float32Array], cache: StageCache) -> StoredClouds:
        """Leaves the clouds in the cache, unless they are there."""
        assert cache.folder is not None  # a cluster has one
        stored = cls(robot, cache.folder.resolve(), digest_of(clouds))
        if cache.find(_STAGE, stored.digest, load=lambda path: path) is None:
            cache.keep(_STAGE, stored.digest, tuple(clouds), save=_save)
        return stored

    def load(self) -> tuple[Float32Array, ...]:
        """The clouds; those of the last robots stay in memory, as the same arrays.

        Raises:
            ConfigError: they are not there.
        """
        return _loaded(self)


def digest_of(clouds: Sequence[Float32Array]) -> str:
    """What tells these clouds from all others."""
    digest = hashlib.sha256()
    for cloud in clouds:
        digest.update(len(cloud).to_bytes(8, "little"))
        digest.update(np.ascontiguousarray(cloud).data)
    return digest.hexdigest()


@lru_cache(maxsize=_MOST_ROBOTS)
def _loaded(stored: StoredClouds) -> tuple[Float32Array, ...]:
    clouds = StageCache(stored.folder).find(_STAGE, stored.digest, load=_load)
    if clouds is None:
        raise ConfigError(
            f"the clouds of {stored.robot} are not in {stored.folder} of this worker; name a folder that all machines"
            " share (WICLOSURE_CACHE), with room for all of it (WICLOSURE_CACHE_GB)"
        )
    return clouds


def _save(clouds: tuple[Float32Array, ...], path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, points=np.concatenate(clouds), offsets=np.cumsum([0, *map(len, clouds)]))


def _load(path: Path) -> tuple[Float32Array, ...]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as pack:
        points, offsets = pack["points"], pack["offsets"]
    return tuple(np.split(points, offsets[1:-1]))
