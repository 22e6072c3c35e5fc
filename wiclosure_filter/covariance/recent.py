"""A memory of what was used last."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable, Iterable
from typing import Generic, TypeVar

_Value = TypeVar("_Value")


class Recent(Generic[_Value]):
    """What was used last, up to so many bytes."""

    def __init__(self, most_bytes: int) -> None:
        self._values: OrderedDict[Hashable, tuple[_Value, int]] = OrderedDict()
        self._most_bytes, self._bytes = most_bytes, 0

    def __contains__(self, key: Hashable) -> bool:
        return key in self._values

    def __getitem__(self, key: Hashable) -> _Value:
        return self._values[key][0]

    def add(self, key: Hashable, value: _Value, size: int) -> None:
        """A new one, of so many bytes."""
        self._values[key] = value, size
        self._bytes += size

    def forget(self, used: Iterable[Hashable]) -> None:
        """Keeps what is used now, the later ones longer, and of the rest what fits."""
        now = list(used)
        for key in now:
            self._values.move_to_end(key)
        while self._bytes > self._most_bytes and len(self._values) > len(now):
            self._bytes -= self._values.popitem(last=False)[1][1]
