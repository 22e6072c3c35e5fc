"""What all formats of cloud files give, and the records that some of them hold."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.field_names import are_of_flight, intensity_field, like_times, time_fields
from wiclosure.pipeline.sources.messages.pointcloud2 import are_returns
from wiclosure.types import FloatArray


class CloudColumns(NamedTuple):
    """The returns in one file.

    Args:
        points: `(N, 3)` metres.
        times, intensity: `(N,)` as recorded, or None.
        time_field: name of the field of the times; without one, of a field that looks like times and is not read.
    """

    points: FloatArray
    times: NDArray[Any] | None
    intensity: NDArray[Any] | None
    time_field: str | None = None


CloudReader: TypeAlias = Callable[[Path], CloudColumns]


class ColumnNames(NamedTuple):
    """Names, in a file, of what is read of it; None: not there."""

    x: str
    y: str
    z: str
    time: str | None
    intensity: str | None

    @property
    def names(self) -> tuple[str, ...]:
        """All that are there, each once."""
        return tuple(dict.fromkeys(name for name in self if name is not None))


def wanted(path: Path, names: Iterable[str]) -> ColumnNames:
    """What is read of fields of these names.

    Raises:
        InputError: one of x, y, z is missing.
    """
    names = list(names)
    by_axis = {name.lower(): name for name in reversed(names)}
    if missing := [axis for axis in "xyz" if axis not in by_axis]:
        raise InputError(
            f"{path} has no field {missing[0]!r} (fields: {', '.join(names) or 'none'}); it is no cloud of points"
        )
    time = next(iter(time_fields(names)), None)
    return ColumnNames(by_axis["x"], by_axis["y"], by_axis["z"], time, intensity_field(names))


def read_whole(path: Path) -> bytes:
    """All bytes of a file.

    Raises:
        InputError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the scan {path}: {error.strerror}; check the path") from error


def returns(columns: Mapping[str, NDArray[Any]], names: ColumnNames) -> CloudColumns:
    """The returns among points given by columns `(N,)`; values keep their types but for the points."""
    x, y, z = (columns[name] for name in names[:3])
    if names.time is not None and are_of_flight(names.time, columns[names.time], x, y, z):
        names = names._replace(time=None)
    keep = are_returns(x, y, z)
    whole = bool(keep.all())
    points = np.empty((len(keep) if whole else int(np.count_nonzero(keep)), 3))
    for column, values in enumerate((x, y, z)):
        points[:, column] = values if whole else values[keep]
    times, intensity = (
        None if name is None else (columns[name].copy() if whole else columns[name][keep])
        for name in (names.time, names.intensity)
    )
    return CloudColumns(points, times, intensity, names.time or next(iter(like_times(columns, ())), None))


def text_numbers(path: Path, body: bytes, count: int, per_point: int) -> FloatArray:
    """Numbers `(count, per_point)` in text.

    Raises:
        InputError: there are fewer, or something that is no number.
    """
    needed = count * per_point
    words = body.split(None, needed)[:needed] if needed <= len(body) else body.split()  # each takes a byte or more
    if len(words) < needed:
        there = len(words) // max(per_point, 1)
        raise InputError(f"{path} is cut short: {count} points are announced, {there} there; copy or remove it")
    try:
        return np.array(words, dtype=np.float64).reshape(count, per_point)
    except ValueError as error:
        raise InputError(f"{path} holds what is no number ({error}); copy it again or remove it") from error
