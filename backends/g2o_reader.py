"""Multi-robot graphs from g2o files: what is usable becomes odometry and closures, what is not is named."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.g2o_lines import Edge, G2oLines, Pose, pose_name
from wiclosure.errors import InputError
from wiclosure.types import Closure, FloatArray, IntArray, KeyframeId, Trajectory

FIGURES = re.compile(r"[0-9.]+")


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


def read_g2o(paths: Sequence[Path]) -> G2oTeam:
    """Reads the graphs of one or several robots.

    GTSAM's symbols name the robots by letters; files that `wiclosure` wrote say whose vertices are whose; plain numbers
    belong to one robot, named after the file.  Edges between consecutive poses of one robot are its odometry, all
    others are closures.  Where a robot's odometry is broken, the rest is another robot, `a.1` after `a`.  Poses of
    vertices only say where a robot starts.

    Raises:
        InputError: a file cannot be read or holds no 3D poses, or a line is malformed.
    """
    files = G2oLines()
    for path in paths:
        files.read(Path(path))
    if not files.vertices:
        names = ", ".join(map(str, paths))
        raise InputError(f"{names}: no VERTEX_SE3:QUAT in it; give g2o files of 3D pose graphs")
    poses: dict[str, list[int]] = {}
    for robot, index in sorted(files.vertices):
        poses.setdefault(robot, []).append(index)
    rank = {(robot, index): n for robot, indices in poses.items() for n, index in enumerate(indices)}
    odometry, loops = _separated(files, rank)
    parts = {part: ends for robot, indices in poses.items() for part, ends in _parts(robot, indices, odometry, files)}
    position = {end: KeyframeId(part, n) for part, ends in parts.items() for n, end in enumerate(ends)}
    closures, places, unusable = _closures(loops, position, files.warnings)
    return G2oTeam(
        odometry={part: _chained(part, ends, odometry, files) for part, ends in parts.items()},
        indices={part: np.array([index for _, index in ends], np.int64) for part, ends in parts.items()},
        keys={part: np.array([files.vertices[end].key for end in ends], np.uint64) for part, ends in parts.items()},
        closures=closures,
        places=places,
        unusable=tuple(unusable),
        warnings=_abridged(files.warnings),
    )


def _abridged(warnings: Sequence[str]) -> tuple[str, ...]:
    """The first of each kind, and how many more there are: a converter's habit is in every line."""
    kinds: dict[str, list[str]] = {}
    for sentence in warnings:
        of_line = sentence.partition(", line ")[2] or sentence
        kinds.setdefault(FIGURES.sub("", of_line), []).append(sentence)
    more = {kind: f" (and {len(alike) - 1} more like it)" if len(alike) > 1 else "" for kind, alike in kinds.items()}
    return tuple(alike[0] + more[kind] for kind, alike in kinds.items())


def _separated(files: G2oLines, rank: dict[Pose, int]) -> tuple[dict[Pose, Edge], list[Edge]]:
    """Odometry edges by the pose that they start from, and all other edges."""
    odometry: dict[Pose, Edge] = {}
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


def _same(one: Edge, other: Edge) -> bool:
    return one.first == other.first and np.array_equal(one.numbers, other.numbers)


def _parts(
    robot: str, indices: list[int], odometry: dict[Pose, Edge], files: G2oLines
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


def _chained(robot: str, ends: list[Pose], odometry: dict[Pose, Edge], files: G2oLines) -> Trajectory:
    steps, covariances = np.zeros((len(ends) - 1, 4, 4)), np.zeros((len(ends) - 1, 6, 6))
    for n, start in enumerate(ends[:-1]):
        edge = odometry[start]
        if edge.defect:
            raise InputError(f"{edge.place}: odometry of {robot}: {edge.defect}; correct the line")
        T, covariance = edge.measured(files.warnings)
        if edge.first != start:
            T, covariance = se3.inverse(T), se3.inverse_covariance(T, covariance)
        steps[n], covariances[n] = T, covariance
    poses = [_start(ends[0], files)]
    for step in steps:
        poses.append(poses[-1] @ step)
    stamps_ns = np.arange(len(poses), dtype=np.int64) * 1_000_000_000
    return Trajectory(robot, stamps_ns, _orthonormal(np.stack(poses)), step_covariances=covariances)


def _start(end: Pose, files: G2oLines) -> FloatArray:
    vertex = files.vertices[end]
    if (T_world_body := vertex.T_world_body) is not None:
        return T_world_body
    files.warnings.append(f"{vertex.place}: {pose_name(*end)} is no pose; its robot starts at the origin instead")
    return np.eye(4)


def _orthonormal(poses: FloatArray) -> FloatArray:
    """Long products of rotations drift off the group by rounding."""
    return se3.from_rotation_translation(Rotation.from_matrix(poses[:, :3, :3]).as_matrix(), poses[:, :3, 3])


def _closures(
    loops: Sequence[Edge], position: dict[Pose, KeyframeId], warnings: list[str]
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
        reason = f"no file has a vertex {pose_name(*missing[0])}" if missing else edge.defect
        if reason:
            unusable.append(UnusableEdge(pose_name(*edge.first), pose_name(*edge.second), edge.place, reason))
            continue
        query, match = position[edge.first], position[edge.second]
        closures.append(Closure.from_measurement(query, match, *edge.measured(warnings)))
        places.append(edge.place)
    return closures, places, unusable
