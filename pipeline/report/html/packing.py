"""Arrays inside a JSON document: bytes, deflated, base64; numbers as whole steps, each stored as its difference."""

from __future__ import annotations

import base64
import math
import zlib
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wiclosure.types import FloatArray

Array: TypeAlias = NDArray[Any]
Packed: TypeAlias = dict[str, Any]

NOT_A_NUMBER = np.iinfo(np.int32).min
_LEVEL = 6  # 9 takes three times as long and saves 1 %


def packed_bytes(array: Array) -> Packed:
    """An array of numbers 0 to 255."""
    return _packed("bytes", array.shape, np.ascontiguousarray(array, np.uint8).tobytes())


def packed_steps(values: Array, step: float) -> Packed:
    """Numbers `(N,)` or `(N, K)` rounded to whole steps; NaN and infinity become NaN.

    Each row is stored as its difference from the one before, and the four bytes of all differences in four planes:
    where neighbours are near each other the upper planes are almost empty and deflate to nothing.
    """
    limit = np.iinfo(np.int32).max
    finite = np.isfinite(values)
    whole = np.where(finite, np.clip(np.round(np.where(finite, values, 0.0) / step), -limit, limit), NOT_A_NUMBER)
    rows = whole.astype(np.int32).reshape(len(values), math.prod(values.shape[1:]))
    difference = rows - np.concatenate([np.zeros_like(rows[:1]), rows[:-1]])  # wraps around, and back on unpacking
    folded = (difference << 1) ^ (difference >> 31)  # small differences of either sign become small numbers
    planes = folded.astype("<i4").ravel().view(np.uint8).reshape(-1, 4).T
    return _packed("steps", values.shape, planes.tobytes()) | {"step": step}


def _packed(kind: str, shape: tuple[int, ...], content: bytes) -> Packed:
    data = base64.b64encode(zlib.compress(content, _LEVEL)).decode("ascii")
    return {"type": kind, "shape": list(shape), "data": data}


def unpacked_array(document: Packed) -> Array:
    """The array that was packed, as the page's script unpacks it."""
    shape = document["shape"]
    size = math.prod(shape) * (1 if document["type"] == "bytes" else 4)
    found = np.frombuffer(zlib.decompressobj().decompress(base64.b64decode(document["data"]), size + 1), np.uint8)
    if document["type"] == "bytes":
        return found.reshape(shape)
    folded = np.ascontiguousarray(found.reshape(4, -1).T).view("<u4").reshape(-1)
    difference = (folded >> 1).astype(np.int32) ^ -(folded & 1).astype(np.int32)
    rows = np.cumsum(difference.reshape(shape), axis=0, dtype=np.int32)
    return np.where(rows == NOT_A_NUMBER, np.nan, rows * document["step"])


def along_curve(points: FloatArray, step_m: float) -> NDArray[np.int64]:
    """Order of points `(N, 3)` along a space-filling (Morton) curve: neighbours in it are neighbours in space."""
    if not len(points):
        return np.zeros(0, np.int64)
    steps = np.round((points - points.min(axis=0)) / step_m).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for axis in range(3):
        for bit in range(20):
            code |= ((steps[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def sharing(report: dict[str, Any]) -> dict[str, Any]:
    """The same document with each array once, under `arrays`: arms of a comparison have many in common."""
    arrays: list[Packed] = []
    known: dict[str, int] = {}

    def shared(node: Any) -> Any:
        if isinstance(node, dict):
            if "data" not in node or "shape" not in node:
                return {key: shared(value) for key, value in node.items()}
            name = f"{node['type']} {node['shape']} {node.get('step')} {node['data']}"
            if known.setdefault(name, len(arrays)) == len(arrays):
                arrays.append(node)
            return {"array": known[name]}
        return [shared(value) for value in node] if isinstance(node, list) else node

    return {**{key: shared(value) for key, value in report.items()}, "arrays": arrays}


def without_sharing(report: dict[str, Any]) -> dict[str, Any]:
    """The document that `sharing` was given."""
    arrays = report["arrays"]

    def whole(node: Any) -> Any:
        if isinstance(node, dict):
            return arrays[node["array"]] if set(node) == {"array"} else {k: whole(v) for k, v in node.items()}
        return [whole(value) for value in node] if isinstance(node, list) else node

    return {key: whole(value) for key, value in report.items() if key != "arrays"}
