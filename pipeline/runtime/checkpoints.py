"""Long work kept in the stage cache now and then: who begins it again goes on from there."""

from __future__ import annotations

import pickle
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Generic, TypeVar

from wiclosure.pipeline.runtime.cache import StageCache

_Work = TypeVar("_Work")
_Item = TypeVar("_Item")

STAGE = "checkpoint"
LEAST_S = 5.0  # of work between two checkpoints
_REST = 20.0  # times what the last one took: keeping them takes a twentieth of the time at most


class Checkpoints(Generic[_Work]):
    """One work that takes items in order, and can be pickled between two of them.

    Args:
        kind: of the work.
        cache: keeps the last checkpoint.
        depends_on: all that the result depends on.
    """

    def __init__(self, kind: type[_Work], cache: StageCache, depends_on: object) -> None:
        self._kind, self._cache, self._depends_on = kind, cache, depends_on

    def last(self) -> _Work | None:
        """The work as far as it came, or None.

        Entries are pickles: only who may run code here should be able to write into the cache's folder.
        """
        return self._cache.find(STAGE, self._depends_on, load=self._load)

    def kept(self, items: Iterable[_Item], work: _Work) -> Iterator[_Item]:
        """The same items; between two of them, the work that takes them is kept now and then."""
        due_s = time.monotonic() + LEAST_S
        for item in items:
            yield item
            began_s = time.monotonic()
            if self._cache.folder is not None and began_s >= due_s:
                self._cache.keep(STAGE, self._depends_on, work, save=_save)
                ended_s = time.monotonic()
                due_s = ended_s + max(LEAST_S, _REST * (ended_s - began_s))

    def drop(self) -> None:
        """When the work is done."""
        self._cache.drop(STAGE, self._depends_on)

    def _load(self, path: Path) -> _Work:
        with path.open("rb") as file:
            work = pickle.load(file)
        if not isinstance(work, self._kind):
            raise TypeError(f"expected {self._kind.__name__}, not {type(work).__name__}")
        return work


def _save(work: object, path: Path) -> None:
    with path.open("wb") as file:
        pickle.dump(work, file, protocol=5)
