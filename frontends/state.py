"""What work in progress knows, as named arrays: a file of them is data that loads without running anything."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

State: TypeAlias = dict[str, NDArray[Any]]
"""Arrays by name."""

_NONE = -1  # the length of an array that is not there


@runtime_checkable
class Resumable(Protocol):
    """Takes items in order; another of it that was made by the same settings can go on in its place, bit by bit."""

    def state(self) -> State:
        """All that the next items depend on."""
        ...

    def restore(self, state: State) -> None:
        """Goes on from the state of another.

        Raises:
            KeyError, ValueError, TypeError, IndexError: it is not the state of such a one.
        """
        ...


def under(name: str, state: State) -> State:
    """The same arrays as a part of a larger state."""
    return {f"{name}.{key}": array for key, array in state.items()}


def part(name: str, state: State) -> State:
    """What `under` made of a part's arrays, as they were."""
    start = f"{name}."
    return {key.removeprefix(start): array for key, array in state.items() if key.startswith(start)}


def packed(arrays: Sequence[NDArray[Any] | None]) -> State:
    """Arrays of one dtype that differ in their first length, or are None, as one."""
    known = [array for array in arrays if array is not None]
    lengths = [_NONE if array is None else len(array) for array in arrays]
    return {"lengths": np.array(lengths, np.int64), "rows": np.concatenate(known) if known else np.zeros(0)}


def unpacked(state: State) -> list[NDArray[Any] | None]:
    """What `packed` was given."""
    lengths, rows = state["lengths"], state["rows"]
    ends = np.cumsum(np.maximum(lengths, 0))
    if len(lengths) and ends[-1] != len(rows):
        raise ValueError(f"{ends[-1]} rows announced, {len(rows)} there")
    return [
        None if length == _NONE else rows[end - length : end]
        for length, end in zip(lengths.tolist(), ends.tolist(), strict=True)
    ]


def unpacked_all(state: State) -> list[NDArray[Any]]:
    """What `packed` was given, where none may be None."""
    return [array for array in unpacked(state) if array is not None]
