"""How long work tells how far it is; the command line draws bars of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
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


class CallbackProgress:
    """Tells a function how far each piece of work is.

    Args:
        told: takes what is done (`odometry of alpha`), how many of its items are done, and of how many; None: unknown.
    """

    def __init__(self, told: Callable[[str, int, int | None], None]) -> None:
        self._told = told

    def track(self, items: Iterable[_Item], label: str, total: int | None = None) -> Iterator[_Item]:
        """The same items, told as they are done."""
        if total is None and isinstance(items, Sized):
            total = len(items)
        self._told(label, 0, total)
        for done, item in enumerate(items, start=1):
            yield item
            self._told(label, done, total)

    def together(self, totals: Mapping[str, int], label: str) -> AbstractContextManager[Callable[[str, int], None]]:
        """Each piece by its own name."""
        return nullcontext(lambda name, done: self._told(f"{label} {name}", done, totals[name] or None))


class NoProgress:
    """Shows nothing."""

    def track(self, items: Iterable[_Item], label: str, total: int | None = None) -> Iterator[_Item]:
        """The same items."""
        return iter(items)

    def together(self, totals: Mapping[str, int], label: str) -> AbstractContextManager[Callable[[str, int], None]]:
        """What shows nothing."""
        return nullcontext(lambda name, done: None)
