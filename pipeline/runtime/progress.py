"""How long work tells how far it is; the command line draws bars of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol, TypeVar

_Item = TypeVar("_Item")


class Progress(Protocol):
    """Shows how far long work is."""

    def track(self, items: Iterable[_Item], label: str, total: int | None = None) -> Iterator[_Item]:
        """The same items, shown as they pass."""
        ...

    def together(self, totals: Mapping[str, int], label: str) -> AbstractContextManager[Callable[[str, int], None]]:
        """Pieces of work side by side; entering gives what takes a piece's name and how many of its items are done."""
        ...


class NoProgress:
    """Shows nothing."""

    def track(self, items: Iterable[_Item], label: str, total: int | None = None) -> Iterator[_Item]:
        """The same items."""
        return iter(items)

    def together(self, totals: Mapping[str, int], label: str) -> AbstractContextManager[Callable[[str, int], None]]:
        """What shows nothing."""
        return nullcontext(lambda name, done: None)
