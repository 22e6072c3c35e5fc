"""PCD files of the Point Cloud Library: ASCII, binary and compressed, with whatever fields.

Read here and not by Open3D, which dies of padding fields.
"""

from __future__ import annotations

import struct
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

import lzf
import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.formats.unpacking import LARGEST_BLOCK
from wiclosure.pipeline.sources.clouds.columns import CloudColumns, read_whole, returns, text_numbers, wanted

_LONGEST_HEADER = 65_536  # bytes
_LARGEST_RATIO = 300  # LZF makes at least one byte of this many
_TYPES = {(kind, size): f"<{kind.lower()}{size}" for kind in "FIU" for size in (1, 2, 4, 8)}
del _TYPES["F", 1]


class _Header(NamedTuple):
    names: list[str]
    formats: list[str]  # NumPy's, one number
    counts: list[int]
    points: int
    data: str

    @property
    def sizes(self) -> list[int]:
        return [np.dtype(of).itemsize * count for of, count in zip(self.formats, self.counts, strict=True)]


def read_pcd(path: Path) -> CloudColumns:
    """A PCD file; per-point times and intensity by their usual names.

    Raises:
        InputError: the file cannot be read, is damaged, or has no x, y and z.
    """
    raw = read_whole(path)
    header, start = _header(path, raw)
    columns = _columns(path, header, raw[start:])
    return returns(columns, wanted(path, header.names))


def _columns(path: Path, header: _Header, body: bytes) -> dict[str, NDArray[Any]]:
    """The fields' first numbers `(N,)`."""
    if header.data == "ascii":
        numbers = text_numbers(path, body, header.points, sum(header.counts))
        starts = [0, *accumulate(header.counts)]
        return {name: numbers[:, start] for name, start in zip(header.names, starts, strict=False) if name != "_"}
    if header.data == "binary":
        return _interleaved(path, header, body)
    if header.data == "binary_compressed":
        return _field_by_field(header, _decompressed(path, header, body))
    raise InputError(f"{path}: data are {header.data!r}; expected ascii, binary or binary_compressed")


def _interleaved(path: Path, header: _Header, body: bytes) -> dict[str, NDArray[Any]]:
    """Fields of points that follow each other."""
    step = sum(header.sizes)
    _check_length(path, header, len(body))
    if header.points == 0:
        return {name: np.zeros(0, of) for name, of in zip(header.names, header.formats, strict=True)}
    starts = [0, *accumulate(header.sizes)]
    return {
        name: np.ndarray((header.points,), of, body, start, (step,))
        for name, of, start in zip(header.names, header.formats, starts, strict=False)
        if name != "_"
    }


def _field_by_field(header: _Header, body: bytes) -> dict[str, NDArray[Any]]:
    """Fields that follow each other, each of all points."""
    starts = [0, *accumulate(size * header.points for size in header.sizes)]
    return {
        name: np.ndarray((header.points,), of, body, start, (size,))
        for name, of, size, start in zip(header.names, header.formats, header.sizes, starts, strict=False)
        if name != "_"
    }


def _decompressed(path: Path, header: _Header, body: bytes) -> bytes:
    needed = sum(header.sizes) * header.points
    if needed == 0:
        return b""
    if len(body) < 8:
        raise InputError(f"{path} is cut short: its compressed data are missing; copy it again or remove it")
    packed, unpacked = struct.unpack_from("<II", body)
    if len(body) < 8 + packed:
        raise InputError(f"{path} is cut short: {packed} bytes are announced, {len(body) - 8} there; copy or remove it")
    if unpacked > LARGEST_BLOCK:
        raise InputError(f"{path} announces {unpacked >> 20} MB of points; no LiDAR makes so many")
    if unpacked < needed or unpacked > _LARGEST_RATIO * packed:
        raise InputError(
            f"{path} is damaged: {packed} bytes cannot hold {unpacked}, and its points take {needed}; copy or remove it"
        )
    try:
        content = lzf.decompress(body[8 : 8 + packed], unpacked)
    except ValueError as error:
        raise InputError(f"{path} is damaged: its data do not unpack ({error}); copy it again or remove it") from error
    if content is None or len(content) != unpacked:
        raise InputError(f"{path} is damaged: its data do not unpack; copy it again or remove it")
    return bytes(content)


def _check_length(path: Path, header: _Header, length: int) -> None:
    step = sum(header.sizes)
    if length < step * header.points:
        there = length // max(step, 1)
        raise InputError(f"{path} is cut short: {header.points} points are announced, {there} there; copy or remove it")


def _header(path: Path, raw: bytes) -> tuple[_Header, int]:
    """The header, and where the data begin."""
    entries: dict[str, list[str]] = {}
    position = 0
    while "DATA" not in entries:
        end = raw.find(b"\n", position, _LONGEST_HEADER)
        if end < 0:
            if position or not raw.startswith(b"DATA"):
                raise InputError(f"{path} has no whole PCD header; copy it again or remove it")
            end = len(raw)
        words = raw[position:end].decode("latin-1").split()
        position = end + 1
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
    try:
        return _parsed(path, entries), position
    except (KeyError, ValueError, IndexError) as error:
        raise InputError(f"{path} has no proper PCD header ({error}); copy it again or remove it") from error


def _parsed(path: Path, entries: dict[str, list[str]]) -> _Header:
    names = entries["FIELDS" if "COLUMNS" not in entries else "COLUMNS"]  # which old files have
    sizes, kinds = [int(word) for word in entries["SIZE"]], [word.upper() for word in entries["TYPE"]]
    counts = [int(word) for word in entries.get("COUNT", ["1"] * len(names))]
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise ValueError("FIELDS, SIZE, TYPE and COUNT differ in number")
    if unknown := [f"{kind}{size}" for kind, size in zip(kinds, sizes, strict=True) if (kind, size) not in _TYPES]:
        raise ValueError(f"unknown type {unknown[0]}")
    if min(counts) < 0:
        raise ValueError("a negative COUNT")
    points = int(entries["POINTS"][0]) if "POINTS" in entries else int(entries["WIDTH"][0]) * int(entries["HEIGHT"][0])
    if points < 0:
        raise ValueError("a negative number of points")
    of_axes = {name.lower(): count for name, count in zip(names, counts, strict=True)}
    if any(of_axes.get(axis, 1) != 1 for axis in "xyz"):
        raise InputError(f"{path}: x, y and z must be one number each; COUNT says otherwise")
    formats = [_TYPES[kind, size] for kind, size in zip(kinds, sizes, strict=True)]
    present = [name if count else "_" for name, count in zip(names, counts, strict=True)]
    return _Header(present, formats, counts, points, entries["DATA"][0].lower())
