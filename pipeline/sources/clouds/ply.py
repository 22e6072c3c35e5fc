"""PLY files: ASCII, and binary of both byte orders, with whatever scalars; faces and the like are not read."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.columns import CloudColumns, read_whole, returns, text_numbers, wanted

_LONGEST_HEADER = 65_536  # bytes
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}


class _Element(NamedTuple):
    name: str
    vertices: int
    properties: list[tuple[str, str]]  # name, NumPy's type
    lists: list[str]

    def record(self, order: str) -> np.dtype[np.void]:
        return np.dtype([(f"{number} {name}", order + of) for number, (name, of) in enumerate(self.properties)])


def read_ply(path: Path) -> CloudColumns:
    """The vertices of a PLY file; per-point times and intensity by their usual names, also after `scalar_`.

    Raises:
        InputError: the file cannot be read, is damaged, or has no vertices with x, y and z.
    """
    raw = read_whole(path)
    how, elements, body = _header(path, raw)
    before = []
    for element in elements:
        if element.name == "vertex":
            break
        before.append(element)
    else:
        raise InputError(f"{path} has no vertices; it is no cloud of points")
    if any(e.lists for e in (*before, element)):
        raise InputError(f"{path}: lists stand before or among its vertices; write it again as a cloud of points")
    columns = _from_text(path, before, element, body) if how == "ascii" else _binary(path, how, before, element, body)
    short = {name.removeprefix("scalar_"): column for name, column in columns.items()}  # as CloudCompare writes them
    return returns(short, wanted(path, short))


def _from_text(path: Path, before: list[_Element], vertex: _Element, body: bytes) -> dict[str, NDArray[Any]]:
    for _ in range(sum(element.vertices for element in before)):
        body = body.partition(b"\n")[2]
    numbers = text_numbers(path, body, vertex.vertices, len(vertex.properties))
    return {name: numbers[:, column] for column, (name, _) in enumerate(vertex.properties)}


def _binary(path: Path, how: str, before: list[_Element], vertex: _Element, body: bytes) -> dict[str, NDArray[Any]]:
    order = _ORDERS[how]
    start = sum(element.record(order).itemsize * element.vertices for element in before)
    record = vertex.record(order)
    if record.itemsize * vertex.vertices > len(body) - start:
        there = max(len(body) - start, 0) // max(record.itemsize, 1)
        raise InputError(
            f"{path} is cut short: {vertex.vertices} points are announced, {there} there; copy or remove it"
        )
    records = np.frombuffer(body, record, vertex.vertices, start) if vertex.vertices else np.zeros(0, record)
    return {name: records[f"{number} {name}"] for number, (name, _) in enumerate(vertex.properties)}


def _header(path: Path, raw: bytes) -> tuple[str, list[_Element], bytes]:
    """How the data are written, what elements there are, and the data."""
    head, end, body = raw[:_LONGEST_HEADER].partition(b"end_header")
    if not raw.startswith(b"ply") or not end:
        raise InputError(f"{path} has no whole PLY header; copy it again or remove it")
    newline = 2 if body[:2] == b"\r\n" else 1
    how, elements = "", list[_Element]()
    try:
        for line in head.decode("latin-1").splitlines()[1:]:
            how = _take_line(line.split(), how, elements)
        if how not in _ORDERS:
            raise ValueError(f"format {how!r}")
    except (ValueError, IndexError, KeyError) as error:
        raise InputError(f"{path} has no proper PLY header ({error}); copy it again or remove it") from error
    return how, elements, raw[len(head) + len(end) + newline :]


def _take_line(words: list[str], how: str, elements: list[_Element]) -> str:
    """Adds what a line of the header says; returns the format."""
    match words:
        case ["format", name, *_]:
            return name
        case ["element", name, count]:
            elements.append(_Element(name, int(count), [], []))
            if int(count) < 0:
                raise ValueError("a negative count")
        case ["property", "list", _, _, name]:
            elements[-1].lists.append(name)
        case ["property", of, name]:
            elements[-1].properties.append((name, _TYPES[of]))
    return how
