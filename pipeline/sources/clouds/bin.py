"""Bare records in a file: KITTI's float32 `x y z reflectance`, or a layout that the data set declares."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.columns import CloudColumns, read_whole, returns, wanted
from wiclosure.pipeline.sources.clouds.record_size import likely_record_size
from wiclosure.pipeline.sources.messages.pointcloud2 import are_returns

logger = logging.getLogger(__name__)

KITTI = "x y z intensity"

# Layouts of known data sets, by name; fields are float32 where nothing else is said.
LAYOUTS: Mapping[str, str] = {
    "kitti": KITTI,
    "nuscenes": "x y z intensity ring",
    "boreas": "x y z intensity ring time",
    "vbr": "x y z intensity time:u4 reflectivity:u2 ring:u1 ambient:u2 range:u4",
    "helipr-ouster": "x y z intensity time:u4 reflectivity:u2 ring:u2 ambient:u2",
    "helipr-velodyne": "x y z intensity ring:u2 time",
    "helipr-avia": "x y z intensity:u1 tag:u1 line:u1 time:u4",
    "helipr-aeva": "x y z reflectivity velocity time:i4 line:u1 intensity",
    "xyz": "x y z",
    "xyz-doubles": "x:f8 y:f8 z:f8",
    "doubles": "x:f8 y:f8 z:f8 intensity:f8",
}
_FORMATS = ("f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8")
_FARTHEST_M = 1e6  # no LiDAR sees so far: larger numbers are no coordinates
_FEWEST_POINTS = 200
_LOW = 2.0  # times as much as up and down a scene spreads along the ground, or more
_ODD = 0.01  # share of points that may hold such numbers


def record_type(layout: str) -> np.dtype[np.void]:
    """The records of a layout: a name of `LAYOUTS`, or fields as `x y z intensity time:u4` (float32 by default).

    Raises:
        InputError: it is neither.
    """
    fields = []
    for word in LAYOUTS.get(layout.lower(), layout).replace(",", " ").split():
        name, _, of = word.partition(":")
        fields.append((name, "<" + (of or "f4")))
        if fields[-1][1][1:] not in _FORMATS:
            raise InputError(f"layout {layout!r}: {word!r} has an unknown type; expected one of {', '.join(_FORMATS)}")
    names = [name for name, _ in fields]
    if len(set(names)) < len(names) or not {"x", "y", "z"} <= {name.lower() for name in names}:
        raise InputError(
            f"layout {layout!r} is not known; give one of {', '.join(LAYOUTS)}, or fields with x, y and z, each once,"
            " as 'x y z intensity time:u4'"
        )
    return np.dtype(fields)


def read_bin(path: Path, layout: str = KITTI) -> CloudColumns:
    """A scan of little endian records; points without a return are left out.

    Raises:
        InputError: the file cannot be read, does not hold whole records, or holds no coordinates.
    """
    raw, record = read_whole(path), record_type(layout)
    if len(raw) % record.itemsize:
        raise InputError(
            f"{path} has {len(raw)} bytes, not a multiple of {record.itemsize} ({_said(layout)}): it is truncated or"
            f" no such scan{_likely(raw, record.itemsize)}; copy it again or remove it"
        )
    records = np.frombuffer(raw, record)
    _refuse_no_coordinates(path, records, layout, raw)
    return returns({name: records[name] for name in record.names or ()}, wanted(path, record.names or ()))


def check_layout(path: Path, layout: str = KITTI) -> None:
    """Looks at one file whether its records are as long as the layout says.

    Raises:
        InputError: they are clearly not, or see `read_bin`.
    """
    read_bin(path, layout)
    raw, size = read_whole(path), record_type(layout).itemsize
    found = likely_record_size(raw, size)
    if found is not None and found != size:
        raise InputError(f"{path}: its values are not {_said(layout)}{_likely(raw, size)}")
    if layout in {KITTI, "kitti"}:
        _doubt_order(path, np.frombuffer(raw, record_type(layout)))


def _doubt_order(path: Path, records: np.ndarray) -> None:
    """Warns where four numbers a point look like `x y z intensity` in another order.

    Coordinates have both signs where a sensor looks around, and reflectances have one; scenes are wider than high.
    """
    seen = records[are_returns(records["x"], records["y"], records["z"]) & ~_no_coordinates(records)]
    if len(seen) < _FEWEST_POINTS:
        return
    negative = {name: float(np.mean(seen[name] < 0)) for name in seen.dtype.names or ()}
    positive = next((axis for axis in "xyz" if negative[axis] == 0), None)
    spread = {axis: float(np.std(seen[axis])) for axis in "xyz"}
    if positive is not None and _ODD < negative["intensity"] < 1 - _ODD:
        order = ["x", "y", "z"]
        order.insert("xyz".index(positive), "intensity")
        logger.warning(
            "%s: read as %s, but its number %d is never negative, as a reflectance, and its last is; say layout: '%s'"
            " in the dataset.yaml where that is their order", path, KITTI, "xyz".index(positive) + 1, " ".join(order),
        )  # fmt: skip
    elif spread["z"] > max(spread["x"], spread["y"], _LOW * min(spread["x"], spread["y"])):
        low = min("xy", key=lambda axis: spread[axis])
        logger.warning(
            "%s: read as %s, but z spreads more (%.3g m) than x and y, and %s least (%.3g m): where another axis points"
            " up, state their order by layout: in the dataset.yaml", path, KITTI, spread["z"], low, spread[low],
        )  # fmt: skip


def _refuse_no_coordinates(path: Path, records: np.ndarray, layout: str, raw: bytes) -> None:
    """Coordinates of another layout are numbers beyond all measure, or below."""
    odd = _no_coordinates(records)
    if len(records) and np.count_nonzero(odd) > _ODD * len(records):
        raise InputError(
            f"{path}: {np.count_nonzero(odd)} of {len(records)} points lie beyond {_FARTHEST_M:g} m or hold no proper"
            f" numbers: its values are not {_said(layout)}{_likely(raw, records.dtype.itemsize)}"
        )


def _no_coordinates(records: np.ndarray) -> NDArray[np.bool_]:
    """Which records `(N,)` hold numbers that are no metres."""
    odd = np.zeros(len(records), bool)
    with np.errstate(invalid="ignore"):
        for axis in "xyz":
            size = np.abs(records[axis])
            odd |= (size > _FARTHEST_M) | ((size > 0) & (size < np.finfo(np.float32).tiny))
    return odd


def _fits(raw: bytes, layout: str, size: int) -> bool:
    """Whether the bytes may be records of that layout, which are of that size."""
    record = record_type(layout)
    if record.itemsize != size:
        return False
    odd = _no_coordinates(np.frombuffer(raw, record, len(raw) // size))
    return bool(np.count_nonzero(odd) <= _ODD * len(odd))


def likely_layouts(path: Path) -> list[str]:
    """Names of the layouts that a file's records may have by their length and values; none where nothing tells.

    Raises:
        InputError: the file cannot be read.
    """
    raw = read_whole(path)
    size = likely_record_size(raw, record_type(KITTI).itemsize)
    return [] if size is None else [name for name in LAYOUTS if _fits(raw, name, size)]


def _said(layout: str) -> str:
    return "float32 x y z reflectance" if layout in {KITTI, "kitti"} else f"records of the layout {layout!r}"


def _likely(raw: bytes, expected: int) -> str:
    """What layout the bytes look like, and how to say so."""
    size = likely_record_size(raw, expected)
    if size is None or size == expected:
        return "; say what they are by layout: in the dataset.yaml"
    known = [name for name in LAYOUTS if _fits(raw, name, size)]
    like = f", as {' or '.join(known)} has them; say layout: {known[0]} in the dataset.yaml if so" if known else (
        "; say what they hold by layout: in the dataset.yaml"
    )  # fmt: skip
    return f"; they look like records of {size} bytes{like}"
