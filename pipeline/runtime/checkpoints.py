"""Long work kept in the stage cache now and then: who begins it again goes on from there."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from wiclosure.formats.unpacking import read_arrays
from wiclosure.frontends.state import Resumable, State
from wiclosure.pipeline.runtime.cache import StageCache

STAGE = "checkpoint"
LEAST_S = 5.0  # of work between two checkpoints
_REST = 20.0  # times what the last one took: keeping them takes a twentieth of the time at most


class _Work(Resumable, Protocol):
    @property
    def resumable(self) -> bool: ...


_WorkT = TypeVar("_WorkT", bound=_Work)
_Item = TypeVar("_Item")


class Checkpoints:
    """Of one work that takes items in order: its state, as arrays, between two of them.

    Args:
        cache: keeps the last checkpoint.
        depends_on: all that the result depends on.
    """

    def __init__(self, cache: StageCache, depends_on: object) -> None:
        self._cache, self._depends_on = cache, depends_on

    def resumed(self, begin: Callable[[], _WorkT]) -> _WorkT:
        """The work as far as it came; what `begin` makes where there is no checkpoint, or a damaged one."""

        def load(path: Path) -> _WorkT:
            work = begin()
            work.restore(read_arrays(path))
            return work

        return self._cache.find(STAGE, self._depends_on, load=load) or begin()

    def kept(self, items: Iterable[_Item], work: _Work) -> Iterator[_Item]:
        """The same items; between two of them, the state of the work that takes them is kept now and then."""
        keeps = self._cache.folder is not None and work.resumable
        due_s = time.monotonic() + LEAST_S
        for item in items:
            yield item
            began_s = time.monotonic()
            if keeps and began_s >= due_s:
                self._cache.keep(STAGE, self._depends_on, work.state(), save=_save)
                ended_s = time.monotonic()
                due_s = ended_s + max(LEAST_S, _REST * (ended_s - began_s))

    def drop(self) -> None:
        """When the work is done."""
        self._cache.drop(STAGE, self._depends_on)


def _save(state: State, path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, **state)
