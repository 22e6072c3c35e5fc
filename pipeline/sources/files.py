"""Clouds in single files: KITTI's `.bin`, and `.pcd` and `.ply` through Open3D."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.pointcloud2 import INTENSITY_FIELDS, TIME_FIELDS, are_returns
from wiclosure.types import FloatArray


class CloudColumns(NamedTuple):
    """The returns in one file: points `(N, 3)` metres, and times and intensity `(N,)` as recorded, where there are."""

    points: FloatArray
    times: NDArray[Any] | None
    intensity: NDArray[Any] | None


CloudReader: TypeAlias = Callable[[Path], CloudColumns]

_BYTES_PER_POINT = 16  # float32 x, y, z, reflectance


def read_bin(path: Path) -> CloudColumns:
    """A KITTI scan: float32 `x y z reflectance`, little endian.

    Raises:
        InputError: the file cannot be read, or its size is not a multiple of 16 bytes.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the scan {path}: {error.strerror}; check the path") from error
    if len(raw) % _BYTES_PER_POINT:
        raise InputError(
            f"{path} has {len(raw)} bytes, not a multiple of {_BYTES_PER_POINT} (float32 x y z reflectance): it is"
            " truncated or no KITTI scan; copy it again or remove it"
        )
    return _returns(np.frombuffer(raw, "<f4").reshape(-1, 4))


def _returns(rows: NDArray[np.float32]) -> CloudColumns:
    keep = are_returns(rows[:, 0], rows[:, 1], rows[:, 2])
    if not keep.all():
        rows = rows[keep]
    return CloudColumns(rows[:, :3].astype(np.float64), None, rows[:, 3])


_PLY_BYTES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "float", "int32", "uint32", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}


def read_with_open3d(path: Path) -> CloudColumns:
    """A PCD or PLY file, ASCII or binary; per-point times and intensity by their usual names.

    Raises:
        InputError: Open3D cannot read the file, or it has no points.
    """
    import open3d as o3d

    if path.suffix.lower() == ".ply":
        _refuse_cut_ply(path)  # Open3D would fill up with whatever lies in memory
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        cloud = o3d.t.io.read_point_cloud(path)
    columns = {name.lower(): cloud.point[name].numpy() for name in cloud.point}
    if "positions" not in columns:
        raise InputError(f"{path} cannot be read as a point cloud; copy it again or remove it")
    points = columns["positions"].astype(np.float64)
    keep = are_returns(*points.T)
    times = _first(columns, TIME_FIELDS, keep)
    return CloudColumns(points[keep], times, _first(columns, INTENSITY_FIELDS, keep))


def _refuse_cut_ply(path: Path) -> None:
    """Compares what the header announces with the bytes, or lines, that are there."""
    header, end, body = path.read_bytes().partition(b"end_header")
    vertices = re.search(rb"element vertex (\d+)((?:\s+(?:property|comment)[^\n]*)*)", header)
    if not end or vertices is None:
        raise InputError(f"{path} has no whole PLY header; copy it again or remove it")
    types = re.findall(rb"property (\w+) \w+", vertices[2])
    announced, size = int(vertices[1]), sum(_PLY_BYTES.get(name.decode(), 0) for name in types)
    there = len(body.split(b"\n")) - 1 if b"format ascii" in header else len(body) // max(size, 1)
    if there < announced:
        raise InputError(f"{path} is cut short: {announced} points are announced, {there} there; copy or remove it")


def _first(columns: Mapping[str, NDArray[Any]], names: tuple[str, ...], keep: NDArray[np.bool_]) -> NDArray[Any] | None:
    found = next((columns[name] for name in names if name in columns), None)
    return None if found is None else found.reshape(len(keep), -1)[keep, 0]


CLOUD_READERS: Mapping[str, CloudReader] = {".bin": read_bin, ".pcd": read_with_open3d, ".ply": read_with_open3d}
