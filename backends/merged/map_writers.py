"""The merged map as files: PLY and PCD point clouds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.errors import OutputError

PLY_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
PCD_POINT = np.dtype([("xyz", "<f4", 3), ("bgr0", "u1", 4)])  # colour packed in one little-endian number, 0x00rrggbb


def write_ply(merged: MergedMap, path: Path) -> None:
    """Writes a binary PLY, float32 points with colours, and intensity where it is known.

    Raises:
        OutputError: the file cannot be written.
    """
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(merged)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        + ("" if merged.intensity is None else "property float intensity\n")
        + "end_header\n"
    )
    vertices = np.empty(len(merged), PLY_VERTEX if merged.intensity is None else _with_intensity(PLY_VERTEX))
    vertices["xyz"], vertices["rgb"] = merged.points, merged.colours
    if merged.intensity is not None:
        vertices["intensity"] = merged.intensity
    _write(path, header, vertices)


def write_pcd(merged: MergedMap, path: Path) -> None:
    """Writes a binary PCD 0.7 as PCL and Open3D read it, float32 points with packed colours, and intensity where known.

    Raises:
        OutputError: the file cannot be written.
    """
    names = ["x", "y", "z", "rgb", *([] if merged.intensity is None else ["intensity"])]
    each = len(names)
    header = (
        f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {' '.join(names)}\n"
        f"SIZE{' 4' * each}\nTYPE{' F' * each}\nCOUNT{' 1' * each}\n"
        f"WIDTH {len(merged)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(merged)}\nDATA binary\n"
    )
    points = np.zeros(len(merged), PCD_POINT if merged.intensity is None else _with_intensity(PCD_POINT))
    points["xyz"], points["bgr0"][:, :3] = merged.points, merged.colours[:, ::-1]
    if merged.intensity is not None:
        points["intensity"] = merged.intensity
    _write(path, header, points)


def _with_intensity(record: np.dtype[np.void]) -> np.dtype[np.void]:
    return np.dtype([*((name, record[name]) for name in record.names or ()), ("intensity", "<f4")])


def _write(path: Path, header: str, rows: NDArray[np.void]) -> None:
    try:
        with path.open("wb") as file:
            file.write(header.encode("ascii"))
            file.write(rows.view(np.uint8).data)  # NumPy's own writing does not say that a disk is full
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error
