"""Arrays inside a JSON document: little-endian bytes, deflated, base64."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

_TYPES = {"u1": "u8", "u2": "u16", "i2": "i16", "i4": "i32", "f4": "f32", "f8": "f64"}


def packed(array: np.ndarray[Any, Any]) -> dict[str, Any]:
    """An array as the page's script unpacks it: type, shape and data."""
    little = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    return {
        "type": _TYPES[little.dtype.str[1:]],
        "shape": list(little.shape),
        "data": base64.b64encode(zlib.compress(little.tobytes(), 9)).decode("ascii"),
    }


def unpacked(document: dict[str, Any]) -> np.ndarray[Any, Any]:
    """The array that was packed."""
    types = {name: kind for kind, name in _TYPES.items()}
    data = zlib.decompress(base64.b64decode(document["data"]))
    return np.frombuffer(data, np.dtype(f"<{types[document['type']]}")).reshape(document["shape"])


def packed_points(points: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Points `(N, 3)` in steps of 1/65535 of their extent: about a centimetre over 650 m, 6 bytes each.

    Sorted along a space-filling order first, neighbours share their high bytes and deflate well; the order is returned
    so that what belongs to the points can follow.
    """
    low = points.min(axis=0).astype(float)
    extent = np.maximum(points.max(axis=0) - low, 1e-3).astype(float)
    steps = np.round((points - low) / extent * 65535).astype(np.uint16)
    order = np.argsort(_morton(steps), kind="stable")
    return {"min": low.tolist(), "extent": extent.tolist(), "xyz": packed(steps[order]), "order": order}


def _morton(steps: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Interleaved high ten bits of three axes."""
    code = np.zeros(len(steps), np.int64)
    for axis in range(3):
        bits = (steps[:, axis] >> 6).astype(np.int64)
        for bit in range(10):
            code |= ((bits >> bit) & 1) << (3 * bit + axis)
    return code
