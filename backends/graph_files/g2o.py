"""Pose graphs as text: g2o's format with its dialects (GTSAM, Ceres, SC-LIO-SAM), and Toro's, planar or not.

Kuemmerle et al., "g2o: A general framework for graph optimization", ICRA 2011; Grisetti et al., "A tree
parameterization for efficiently computing maximum likelihood maps using gradient descent", RSS 2007 (Toro).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from wiclosure.backends.graph_files.open import read_text
from wiclosure.backends.graph_files.records import (
    UNIT_TOLERANCE,
    Edge,
    FileRecords,
    Remarks,
    Vertex,
    from_euler,
    from_planar,
    from_quaternions,
    lifted_information,
    require_key,
)
from wiclosure.errors import InputError
from wiclosure.types import FloatArray

OWN_RANGE = re.compile(r"# keyframes of (.+): vertices (\d+) to (\d+)")
OWN_KEYS = re.compile(r"# keys of (.+): ([\d -]+)")
DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
MOST_KEYS = 10**7  # of one span in a comment; more is a mistake
NO_POSES = ("FIX", "PARAMS", "VERTEX_SWITCH", "EDGE_SWITCH_PRIOR")
Rows: TypeAlias = list[tuple[int, list[str]]]
"""Line number, and the words after the tag."""
Triangle: TypeAlias = tuple[tuple[int, int], ...]
"""Row and column of each number of an upper triangle."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What follows a tag.

    Args:
        keys: one for a vertex, two for an edge.
        numbers: how many a pose has.
        poses: turns rows of them into transforms, and says what is wrong with each row.
        upper: rows and columns of the information matrix in the order of the file; empty for a vertex.
        switch: whether the number of a switch, or a weight, stands before the pose: the edge may be false.
    """

    keys: int
    numbers: int
    poses: Callable[[FloatArray], tuple[FloatArray, list[str]]]
    upper: Triangle = ()
    switch: bool = False


ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])  # the files have translation first
_SIX = tuple((i, j) for i in range(6) for j in range(i, 6))
_THREE = tuple((i, j) for i in range(3) for j in range(i, 3))
_TORO = ((0, 0), (0, 1), (1, 1), (2, 2), (0, 2), (1, 2))
_OTHER_ORDER = {_THREE: _TORO, _TORO: _THREE}
_PLANAR_EDGE, _TORO_EDGE = Layout(2, 3, from_planar, _THREE), Layout(2, 3, from_planar, _TORO)
_SPATIAL_EDGE = Layout(2, 7, from_quaternions, _SIX)
LINE_LAYOUTS = {
    "VERTEX_SE3:QUAT": Layout(1, 7, from_quaternions),
    "EDGE_SE3:QUAT": _SPATIAL_EDGE,
    "EDGE_SE3_SWITCHABLE": replace(_SPATIAL_EDGE, switch=True),
    "EDGE_SE3_MAXMIX": replace(_SPATIAL_EDGE, switch=True),
    "VERTEX_SE3:EULER": Layout(1, 6, from_euler),
    "EDGE_SE3:EULER": Layout(2, 6, from_euler, _SIX),
    "VERTEX3": Layout(1, 6, from_euler),
    "EDGE3": Layout(2, 6, from_euler, _SIX),
    "VERTEX_SE2": Layout(1, 3, from_planar),
    "EDGE_SE2": _PLANAR_EDGE,
    "EDGE_SE2_SWITCHABLE": replace(_PLANAR_EDGE, switch=True),
    "EDGE_SE2_MAXMIX": replace(_PLANAR_EDGE, switch=True),
    "ODOMETRY": _PLANAR_EDGE,
    "VERTEX": Layout(1, 3, from_planar),
    "EDGE": _TORO_EDGE,
    "VERTEX2": Layout(1, 3, from_planar),
    "EDGE2": _TORO_EDGE,
}
PLANAR_TAGS = {tag for tag, layout in LINE_LAYOUTS.items() if layout.numbers == 3}


def read_text_graph(path: Path, name: str, remarks: Remarks) -> FileRecords:
    """All vertices and edges of a file.

    Raises:
        InputError: the file cannot be read, or a line is malformed.
    """
    records = FileRecords(path, name)
    rows: dict[str, Rows] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        tag, *words = line.split() or [""]
        if tag in LINE_LAYOUTS:
            rows.setdefault(tag, []).append((number, words[: words.index("#")] if "#" in words else words))
        elif tag:
            _set_aside(records, remarks, number, line)
    lines: list[int] = []
    for tag, of_tag in rows.items():
        if LINE_LAYOUTS[tag].keys == 1:
            records.vertices += _vertices(path, tag, of_tag)
        else:
            records.edges += _edges(path, tag, of_tag, remarks)
            lines += [number for number, _ in of_tag]
    records.edges = [records.edges[n] for n in np.argsort(lines, kind="stable")]
    records.planar = bool(rows) and rows.keys() <= PLANAR_TAGS
    return records


def _set_aside(records: FileRecords, remarks: Remarks, number: int, line: str) -> None:
    """Counts a line that is no pose and no edge; some comments are ours."""
    tag = line.split(maxsplit=1)[0][:40]
    if tag[0] in "#%":
        if own := OWN_RANGE.fullmatch(line.strip()):
            records.ranges.append((own[1], int(own[2]), int(own[3])))
        elif own := OWN_KEYS.fullmatch(line.strip()):
            records.owners |= dict.fromkeys(_spans(own[2]), own[1])
        else:
            records.ignored["comment"] += 1
        return
    records.ignored[tag] += 1
    if not tag.startswith(NO_POSES):
        remarks.add(
            f"{records.path} {tag}", f"{records.path}, line {number}: {tag!r} is no kind of line known here; ignored"
        )


def _spans(words: str) -> Iterator[int]:
    """The numbers of `0-3 5 7-8`; what is no such span names none."""
    for word in words.split():
        first, _, last = word.partition("-")
        if first.isdecimal() and (last or first).isdecimal() and int(last or first) - int(first) <= MOST_KEYS:
            yield from range(int(first), int(last or first) + 1)


def _vertices(path: Path, tag: str, rows: Rows) -> list[Vertex]:
    layout = LINE_LAYOUTS[tag]
    keys, numbers = _fields(path, tag, rows, (layout.numbers,))
    poses, _ = layout.poses(numbers)
    places = [f"{path}, line {number}" for number, _ in rows]
    return [Vertex(key, place, T) for (key,), place, T in zip(keys, places, poses, strict=True)]


def _edges(path: Path, tag: str, rows: Rows, remarks: Remarks) -> Iterator[Edge]:
    layout = LINE_LAYOUTS[tag]
    if layout.switch:
        rows = [(number, [*words[: layout.keys], *words[layout.keys + 1 :]]) for number, words in rows]
    keys, numbers = _fields(path, tag, rows, (layout.numbers, layout.numbers + len(layout.upper)))
    poses, defects = layout.poses(numbers[:, : layout.numbers])
    stated = np.array([len(words) > 2 + layout.numbers for _, words in rows])
    values = np.where(stated[:, None], numbers[:, layout.numbers :], 0.0)
    information = _information(values, layout.upper, f"{path}, line {rows[0][0]}: {tag}", remarks)
    if layout.numbers == 7:
        usable = np.array([not defect for defect in defects])
        _tell_lengths(path, rows, np.linalg.norm(np.where(usable[:, None], numbers[:, 3:7], 0.5), axis=1), remarks)
    for n, (number, _) in enumerate(rows):
        place, matrix = f"{path}, line {number}", information[n] if stated[n] else None
        first, second = keys[n]
        yield Edge(first, second, place, poses[n], matrix, defects[n], may_be_false=layout.switch or None)


def _information(values: FloatArray, upper: Triangle, place: str, remarks: Remarks) -> FloatArray:
    """`(N, 6, 6)`, rotation first, of what the file states `(N, len(upper))`.

    Converters mix up the two orders of planar matrices.  What is positive in the right one is not in the other, so the
    order that leaves by far fewer indefinite ones is the right one.
    """
    if upper not in _OTHER_ORDER:
        return _symmetric(values, upper)[:, ROTATION_FIRST][:, :, ROTATION_FIRST]
    stated, swapped = _symmetric(values, upper), _symmetric(values, _OTHER_ORDER[upper])
    if 2 * _n_indefinite(swapped) >= _n_indefinite(stated):
        return lifted_information(stated)
    remarks.add(place, f"{place}: its matrices have the order of {'Toro' if upper == _THREE else 'g2o'}; read so")
    return lifted_information(swapped)


def _symmetric(values: FloatArray, upper: Triangle) -> FloatArray:
    size = 1 + max(map(max, upper))
    matrices = np.zeros((len(values), size, size))
    for column, (i, j) in enumerate(upper):
        matrices[:, i, j] = matrices[:, j, i] = values[:, column]
    return matrices


def _n_indefinite(matrices: FloatArray) -> int:
    finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    eigenvalues = np.linalg.eigvalsh(matrices[finite])
    return int((eigenvalues[:, 0] < -1e-9 * np.maximum(eigenvalues[:, -1], 1.0)).sum())


def _tell_lengths(path: Path, rows: Rows, length: FloatArray, remarks: Remarks) -> None:
    odd = np.flatnonzero(np.abs(length - 1) > UNIT_TOLERANCE)
    for n in odd[:1]:
        sentence = f"{path}, line {rows[n][0]}: the quaternion has length {length[n]:.4g}; normalised"
        remarks.add("quaternion length", sentence, len(odd))


def _fields(path: Path, tag: str, rows: Rows, counts: Sequence[int]) -> tuple[list[list[int]], FloatArray]:
    """Keys of each row, and the numbers after them; rows that have fewer of them than others end in zeros.

    Raises:
        InputError: a row has another number of words than `counts` allow, or one is no number.
    """
    n_keys, widest = LINE_LAYOUTS[tag].keys, max(counts)
    keys, numbers = [], np.zeros((len(rows), widest))
    for row, (number, words) in enumerate(rows):
        place = f"{path}, line {number}"
        try:
            keys.append([require_key(_key(word), place) for word in words[:n_keys]])
            values = [float(word) for word in words[n_keys:]]
        except ValueError as error:
            raise InputError(_no_number(place, words, error)) from None
        if len(values) not in counts:
            expected = " or ".join(str(n_keys + count) for count in counts)
            raise InputError(f"{place}: expected {expected} fields after {tag}, found {len(words)}; the file is cut?")
        numbers[row, : len(values)] = values
    return keys, numbers


def _key(word: str) -> int:
    try:
        return int(word)
    except ValueError:
        raise ValueError(f"the key {word[:40]!r} is no whole number") from None


def _no_number(place: str, words: Sequence[str], error: ValueError) -> str:
    if commas := [word for word in words if DECIMAL_COMMA.fullmatch(word)]:
        return (
            f"{place}: {commas[0]!r} has a decimal comma; write the file with decimal points"
            " (LC_NUMERIC=C for the program that writes it)"
        )
    return f"{place}: {str(error)[:100]}; expected numbers"
