"""Multi-robot graphs from g2o files: what is usable becomes odometry and closures, what is not is named."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.types import Closure, Decision, Evidence, FloatArray, IntArray, KeyframeId, Trajectory

SYMBOL_SHIFT = 56  # GTSAM's symbols: a letter in the first byte, the index in the others
ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])  # g2o has translation first
LEAST_INFORMATION = 1e-8  # 10 km, 10,000 rad: nothing is known along that axis
UNIT_TOLERANCE = 1e-3  # quaternions printed with four decimals stay within this of length one
OWN_COMMENT = re.compile(r"# keyframes of (.+): vertices (\d+) to (\d+)")
FIGURES = re.compile(r"[0-9.]+")
Pose = tuple[str, int]
"""Robot and the index that the file gives."""


@dataclass(frozen=True, slots=True)
class UnusableEdge:
    """A closure that cannot be used, where it stands, and why."""

    first: str
    second: str
    place: str
    reason: str


@dataclass(frozen=True, eq=False)
class G2oTeam:
    """Several robots' graphs.

    Args:
        odometry: by robot, chained from its edges, which state the covariance of each step. Keyframe n has the stamp
            n seconds: g2o knows no time.
        indices: `(N,)` by robot: the index that the files give each keyframe.
        keys: `(N,)` uint64 by robot: the whole key in the files.
        closures: all other edges, each once although both robots' files may hold it.
        places: file and line of each closure.
        unusable: edges that are left out.
        warnings: sentences: what was repaired or ignored.
    """

    odometry: dict[str, Trajectory]
    indices: dict[str, IntArray]
    keys: dict[str, NDArray[np.uint64]]
    closures: list[Closure]
    places: list[str]
    unusable: tuple[UnusableEdge, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Edge:
    first: Pose
    second: Pose
    place: str
    numbers: FloatArray  # x y z qx qy qz qw, then the upper triangle of the information


@dataclass
class _Files:
    """What stands in the files, as it stands there."""

    starts: dict[Pose, tuple[int, str, FloatArray]] = field(default_factory=dict)  # key, place, x y z qx qy qz qw
    edges: list[_Edge] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def read_g2o(paths: Sequence[Path]) -> G2oTeam:
    """Reads the graphs of one or several robots.

    GTSAM's symbols name the robots by letters; files that `wiclosure` wrote say whose vertices are whose; plain numbers
    belong to one robot, named after the file.  Edges between consecutive poses of one robot are its odometry, all
    others are closures.  Where a robot's odometry is broken, the rest is another robot, `a.1` after `a`.  Poses of
    vertices only say where a robot starts.

    Raises:
        InputError: a file cannot be read or holds no 3D poses, or a line is malformed.
    """
    files = _Files()
    for path in paths:
        _parse(Path(path), files)
    if not files.starts:
        names = ", ".join(map(str, paths))
        raise InputError(f"{names}: no VERTEX_SE3:QUAT in it; give g2o files of 3D pose graphs")
    poses: dict[str, list[int]] = {}
    for robot, index in sorted(files.starts):
        poses.setdefault(robot, []).append(index)
    rank = {(robot, index): n for robot, indices in poses.items() for n, index in enumerate(indices)}
    odometry, loops = _separated(files, rank)
    parts = {part: ends for robot, indices in poses.items() for part, ends in _parts(robot, indices, odometry, files)}
    position = {end: KeyframeId(part, n) for part, ends in parts.items() for n, end in enumerate(ends)}
    closures, places, unusable = _closures(loops, position, files.warnings)
    return G2oTeam(
        odometry={part: _chained(part, ends, odometry, files) for part, ends in parts.items()},
        indices={part: np.array([index for _, index in ends], np.int64) for part, ends in parts.items()},
        keys={part: np.array([files.starts[end][0] for end in ends], np.uint64) for part, ends in parts.items()},
        closures=closures,
        places=places,
        unusable=tuple(unusable),
        warnings=_abridged(files.warnings),
    )


def pose_name(robot: str, index: int) -> str:
    """For the user: `a12` for symbols, `alpha 12` else."""
    return f"{robot[0]}{index}" if len(robot) == 1 or robot[1] == "." else f"{robot} {index}"


def _abridged(warnings: Sequence[str]) -> tuple[str, ...]:
    """The first of each kind, and how many more there are: a converter's habit is in every line."""
    kinds: dict[str, list[str]] = {}
    for sentence in warnings:
        of_line = sentence.partition(", line ")[2] or sentence
        kinds.setdefault(FIGURES.sub("", of_line), []).append(sentence)
    more = {kind: f" (and {len(alike) - 1} more like it)" if len(alike) > 1 else "" for kind, alike in kinds.items()}
    return tuple(alike[0] + more[kind] for kind, alike in kinds.items())


# ------------------------------------------------------------------------------------------------------------ parsing
def _parse(path: Path, files: _Files) -> None:
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InputError(f"cannot read the graph {path}: {error.strerror}; check the path") from error
    ranges = [(m[1], int(m[2]), int(m[3])) for m in map(OWN_COMMENT.fullmatch, lines) if m]
    for number, line in enumerate(lines, start=1):
        tag, *words = line.split() or ["#"]
        place = f"{path}, line {number}"
        if tag == "VERTEX_SE3:QUAT":
            (key,), pose = _fields(words, 1, 7, place)
            _add_vertex(_named(key, path, ranges), key, pose, place, files)
        elif tag == "EDGE_SE3:QUAT":
            (first, second), numbers = _fields(words, 2, 28, place)
            ends = _named(first, path, ranges), _named(second, path, ranges)
            files.edges.append(_Edge(*ends, place, numbers))
        elif tag.endswith("SE2") or "SE2:" in tag:
            raise InputError(f"{place}: {tag} is of a planar graph; give a 3D one (SE3:QUAT)")
        elif tag != "FIX" and not tag.startswith("#"):
            files.warnings.append(f"{place}: {tag[:40]!r} is no g2o word known here; the line is ignored")


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


def _add_vertex(pose: Pose, key: int, numbers: FloatArray, place: str, files: _Files) -> None:
    if pose not in files.starts:
        files.starts[pose] = (key, place, numbers)
    elif not np.array_equal(files.starts[pose][2], numbers):
        files.warnings.append(f"{place}: {pose_name(*pose)} stands already in {files.starts[pose][1]}; that is used")


# ----------------------------------------------------------------------------------------- odometry, closures apart
def _separated(files: _Files, rank: dict[Pose, int]) -> tuple[dict[Pose, _Edge], list[_Edge]]:
    """Odometry edges by the pose that they start from, and all other edges."""
    odometry: dict[Pose, _Edge] = {}
    loops = []
    for edge in files.edges:
        step = rank.get(edge.second, -9) - rank.get(edge.first, -99)
        start = edge.first if step > 0 else edge.second
        if edge.first[0] != edge.second[0] or abs(step) != 1:
            loops.append(edge)
        elif start not in odometry:
            odometry[start] = edge
        elif not _same(edge, odometry[start]):
            loops.append(edge)
    return odometry, loops


def _same(one: _Edge, other: _Edge) -> bool:
    return one.first == other.first and np.array_equal(one.numbers, other.numbers)


def _parts(
    robot: str, indices: list[int], odometry: dict[Pose, _Edge], files: _Files
) -> Iterator[tuple[str, list[Pose]]]:
    """The poses of one robot, cut where its odometry is broken."""
    breaks = [n for n, index in enumerate(indices[:-1], start=1) if (robot, index) not in odometry]
    for number, (first, last) in enumerate(pairwise([0, *breaks, len(indices)])):
        part = f"{robot}.{number}" if number else robot
        if number:
            before, after = (pose_name(robot, indices[n]) for n in (first - 1, first))
            files.warnings.append(
                f"the odometry of {robot} is broken: none between {before} and {after}; the rest is {part}"
            )
        yield part, [(robot, index) for index in indices[first:last]]


def _chained(robot: str, ends: list[Pose], odometry: dict[Pose, _Edge], files: _Files) -> Trajectory:
    steps, covariances = np.zeros((len(ends) - 1, 4, 4)), np.zeros((len(ends) - 1, 6, 6))
    for n, start in enumerate(ends[:-1]):
        edge = odometry[start]
        if reason := _defect(edge.numbers):
            raise InputError(f"{edge.place}: odometry of {robot}: {reason}; correct the line")
        T, covariance = _measured(edge, files.warnings)
        if edge.first != start:
            T, covariance = se3.inverse(T), se3.inverse_covariance(T, covariance)
        steps[n], covariances[n] = T, covariance
    poses = [_start(ends[0], files)]
    for step in steps:
        poses.append(poses[-1] @ step)
    stamps_ns = np.arange(len(poses), dtype=np.int64) * 1_000_000_000
    return Trajectory(robot, stamps_ns, _orthonormal(np.stack(poses)), step_covariances=covariances)


def _start(end: Pose, files: _Files) -> FloatArray:
    _, place, numbers = files.starts[end]
    if not np.isfinite(numbers).all() or np.linalg.norm(numbers[3:]) < UNIT_TOLERANCE:
        files.warnings.append(f"{place}: {pose_name(*end)} is no pose; its robot starts at the origin instead")
        return np.eye(4)
    return _pose(numbers)


def _orthonormal(poses: FloatArray) -> FloatArray:
    """Long products of rotations drift off the group by rounding."""
    return se3.from_rotation_translation(Rotation.from_matrix(poses[:, :3, :3]).as_matrix(), poses[:, :3, 3])


def _closures(
    loops: Sequence[_Edge], position: dict[Pose, KeyframeId], warnings: list[str]
) -> tuple[list[Closure], list[str], list[UnusableEdge]]:
    """Each loop once: many writers put those between robots into both robots' files."""
    closures, places, unusable = [], [], []
    seen: set[tuple[object, ...]] = set()
    for edge in loops:
        identity = (edge.first, edge.second, edge.numbers[:7].tobytes())
        if identity in seen:
            continue
        seen.add(identity)
        missing = [end for end in (edge.first, edge.second) if end not in position]
        reason = _defect(edge.numbers)
        if missing:
            reason = f"no file has a vertex {pose_name(*missing[0])}"
        if reason:
            unusable.append(UnusableEdge(pose_name(*edge.first), pose_name(*edge.second), edge.place, reason))
            continue
        query, match = position[edge.first], position[edge.second]
        closures.append(Closure(query, match, *_measured(edge, warnings), Evidence(), Decision.VERIFIED))
        places.append(edge.place)
    return closures, places, unusable


def _defect(numbers: FloatArray) -> str:
    """Why an edge cannot be used; empty if it can."""
    if not np.isfinite(numbers).all():
        return "a number is not finite"
    if np.linalg.norm(numbers[3:7]) < UNIT_TOLERANCE:
        return "its quaternion is zero"
    eigenvalues = np.linalg.eigvalsh(_information(numbers))
    if eigenvalues[0] < -1e-9 * max(eigenvalues[-1], 1.0):
        return "its information matrix is not positive semi-definite"
    return ""


def _measured(edge: _Edge, warnings: list[str]) -> tuple[FloatArray, FloatArray]:
    """Transform and covariance of a usable edge."""
    length = np.linalg.norm(edge.numbers[3:7])
    if abs(length - 1) > UNIT_TOLERANCE:
        warnings.append(f"{edge.place}: the quaternion has length {length:.4g}; normalised")
    eigenvalues, axes = np.linalg.eigh(_information(edge.numbers))
    if eigenvalues[0] < LEAST_INFORMATION:
        warnings.append(f"{edge.place}: the information matrix is singular; the axis without is taken as unknown")
    return _pose(edge.numbers), (axes / np.maximum(eigenvalues, LEAST_INFORMATION)) @ axes.T


def _information(numbers: FloatArray) -> FloatArray:
    """`(6, 6)`, rotation first."""
    information = np.zeros((6, 6))
    information[np.triu_indices(6)] = numbers[7:]
    information += np.triu(information, 1).T
    return np.asarray(information[np.ix_(ROTATION_FIRST, ROTATION_FIRST)])


def _pose(numbers: FloatArray) -> FloatArray:
    return se3.from_rotation_translation(Rotation.from_quat(numbers[3:7]).as_matrix(), numbers[:3])
