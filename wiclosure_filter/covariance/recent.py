"""A memory of what was used last."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

_Value = TypeVar("_Value")


class Recent(Generic[_Value]):
    """What was used last, up to so many bytes, and the last of it in any case."""

    def __init__(self, most_bytes: int) -> None:
        self._values: OrderedDict[Hashable, tuple[_Value, int]] = OrderedDict()
        self._most_bytes, self._bytes = most_bytes, 0

    def reuse(self, key: Hashable, compute: Callable[[], tuple[_Value, int]]) -> _Value:
        """What is known under this key; else what is computed, and the bytes that it takes."""
        if key not in self._values:
            self._values[key] = compute()
            self._bytes += self._values[key][1]
            while self._bytes > self._most_bytes and len(self._values) > 1:
                self._bytes -= self._values.popitem(last=False)[1][1]
        self._values.move_to_end(key)
        return self._values[key][0]
