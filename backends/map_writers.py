"""The merged map as files: PLY and PCD point clouds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wiclosure.backends.merged_map import MergedMap
from wiclosure.errors import OutputError

PLY_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
PCD_POINT = np.dtype([("xyz", "<f4", 3), ("bgr0", "u1", 4)])  # colour packed in one little-endian number, 0x00rrggbb


def write_ply(merged: MergedMap, path: Path) -> None:
    """Writes a binary PLY, float32 points with colours.

    Raises:
        OutputError: the file cannot be written.
    """
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(merged)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    vertices = np.empty(len(merged), PLY_VERTEX)
    vertices["xyz"], vertices["rgb"] = merged.points, merged.colours
    _write(path, header, vertices)


def write_pcd(merged: MergedMap, path: Path) -> None:
    """Writes a binary PCD 0.7 as PCL and Open3D read it, float32 points with packed colours.

    Raises:
        OutputError: the file cannot be written.
    """
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\n"
        f"COUNT 1 1 1 1\nWIDTH {len(merged)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(merged)}\nDATA binary\n"
    )
    points = np.zeros(len(merged), PCD_POINT)
    points["xyz"], points["bgr0"][:, :3] = merged.points, merged.colours[:, ::-1]
    _write(path, header, points)


def _write(path: Path, header: str, rows: NDArray[np.void]) -> None:
    try:
        with path.open("wb") as file:
            file.write(header.encode("ascii"))
            rows.tofile(file)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error
