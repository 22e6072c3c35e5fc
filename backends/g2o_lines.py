"""What stands in g2o files of 3D pose graphs, as it stands there: vertices, edges, and the line of each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.types import FloatArray

SYMBOL_SHIFT = 56  # GTSAM's symbols: a letter in the first byte, the index in the others
ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])  # g2o has translation first
LEAST_INFORMATION = 1e-8  # 10 km, 10,000 rad: nothing is known along that axis
UNIT_TOLERANCE = 1e-3  # quaternions printed with four decimals stay within this of length one
OWN_COMMENT = re.compile(r"# keyframes of (.+): vertices (\d+) to (\d+)")

Pose: TypeAlias = tuple[str, int]
"""Robot and the index that the file gives."""


def pose_name(robot: str, index: int) -> str:
    """For the user: `a12` for symbols, `alpha 12` else."""
    return f"{robot[0]}{index}" if len(robot) == 1 or robot[1] == "." else f"{robot} {index}"


@dataclass(frozen=True, slots=True, eq=False)
class Vertex:
    """A first guess of a pose.

    Args:
        key: the whole number in the file.
        place: file and line.
        numbers: `(7,)` x y z qx qy qz qw.
    """

    key: int
    place: str
    numbers: FloatArray

    @property
    def T_world_body(self) -> FloatArray | None:
        """`(4, 4)`, or None where the numbers are no pose."""
        usable = np.isfinite(self.numbers).all() and np.linalg.norm(self.numbers[3:]) >= UNIT_TOLERANCE
        return _transform(self.numbers) if usable else None


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A relative pose of two vertices.

    Args:
        first, second: the poses that it joins.
        place: file and line.
        numbers: `(28,)` x y z qx qy qz qw, then the upper triangle of the information matrix, translation first.
    """

    first: Pose
    second: Pose
    place: str
    numbers: FloatArray

    @property
    def defect(self) -> str:
        """Why it cannot be used; empty if it can."""
        if not np.isfinite(self.numbers).all():
            return "a number is not finite"
        if np.linalg.norm(self.numbers[3:7]) < UNIT_TOLERANCE:
            return "its quaternion is zero"
        eigenvalues = np.linalg.eigvalsh(self._information)
        if eigenvalues[0] < -1e-9 * max(eigenvalues[-1], 1.0):
            return "its information matrix is not positive semi-definite"
        return ""

    def measured(self, warnings: list[str]) -> tuple[FloatArray, FloatArray]:
        """`T_first_second (4, 4)` and covariance `(6, 6)` of an edge without defect; `warnings` get what was mended."""
        length = np.linalg.norm(self.numbers[3:7])
        if abs(length - 1) > UNIT_TOLERANCE:
            warnings.append(f"{self.place}: the quaternion has length {length:.4g}; normalised")
        eigenvalues, axes = np.linalg.eigh(self._information)
        if eigenvalues[0] < LEAST_INFORMATION:
            warnings.append(f"{self.place}: the information matrix is singular; the axis without is taken as unknown")
        return _transform(self.numbers), (axes / np.maximum(eigenvalues, LEAST_INFORMATION)) @ axes.T

    @property
    def _information(self) -> FloatArray:
        """`(6, 6)`, rotation first."""
        information = np.zeros((6, 6))
        information[np.triu_indices(6)] = self.numbers[7:]
        information += np.triu(information, 1).T
        return np.asarray(information[np.ix_(ROTATION_FIRST, ROTATION_FIRST)])


@dataclass(slots=True)
class G2oLines:
    """All that stands in some files.

    Args:
        vertices: by robot and index, the first of each.
        edges: in order.
        warnings: sentences: what was mended or ignored.
    """

    vertices: dict[Pose, Vertex] = field(default_factory=dict)
    edges: list[Edge] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def read(self, path: Path) -> None:
        """Adds what stands in a file.

        Raises:
            InputError: the file cannot be read, is of a planar graph, or a line is malformed.
        """
        try:
            lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        except OSError as error:
            raise InputError(f"cannot read the graph {path}: {error.strerror}; check the path") from error
        ranges = [(m[1], int(m[2]), int(m[3])) for m in map(OWN_COMMENT.fullmatch, lines) if m]
        for number, line in enumerate(lines, start=1):
            tag, *words = line.split() or ["#"]
            place = f"{path}, line {number}"
            if tag == "VERTEX_SE3:QUAT":
                (key,), numbers = _fields(words, 1, 7, place)
                self._add(_named(key, path, ranges), Vertex(key, place, numbers))
            elif tag == "EDGE_SE3:QUAT":
                (first, second), numbers = _fields(words, 2, 28, place)
                ends = _named(first, path, ranges), _named(second, path, ranges)
                self.edges.append(Edge(*ends, place, numbers))
            elif tag.endswith("SE2") or "SE2:" in tag:
                raise InputError(f"{place}: {tag} is of a planar graph; give a 3D one (SE3:QUAT)")
            elif tag != "FIX" and not tag.startswith("#"):
                self.warnings.append(f"{place}: {tag[:40]!r} is no g2o word known here; the line is ignored")

    def _add(self, pose: Pose, vertex: Vertex) -> None:
        known = self.vertices.setdefault(pose, vertex)
        if known is not vertex and not np.array_equal(known.numbers, vertex.numbers):
            self.warnings.append(f"{vertex.place}: {pose_name(*pose)} stands already in {known.place}; that is used")


def _fields(words: list[str], keys: int, numbers: int, place: str) -> tuple[list[int], FloatArray]:
    if len(words) != keys + numbers:
        raise InputError(
            f"{place}: expected {keys + numbers} fields after the word, found {len(words)}; the file is cut?"
        )
    try:
        ids, values = [int(word) for word in words[:keys]], np.array(words[keys:], float)
    except ValueError as error:
        raise InputError(f"{place}: {error}; expected numbers") from None
    if any(not 0 <= key < 1 << 64 for key in ids):
        raise InputError(f"{place}: a key must be a number from 0 to 2^64 - 1")
    return ids, values


def _named(key: int, path: Path, ranges: Sequence[tuple[str, int, int]]) -> Pose:
    letter = chr(key >> SYMBOL_SHIFT)
    if letter.isprintable() and letter != " ":
        return letter, key & ((1 << SYMBOL_SHIFT) - 1)
    for robot, first, last in ranges:
        if first <= key <= last:
            return robot, key - first
    return path.stem, key


def _transform(numbers: FloatArray) -> FloatArray:
    return se3.from_rotation_translation(Rotation.from_quat(numbers[3:7]).as_matrix(), numbers[:3])
