"""What stands in the files of pose graphs, whatever their format: vertices, edges, and the place of each."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.types import BoolArray, FloatArray

FURTHEST_M = 1e8  # from here on a coordinate is a mistake, and its square loses what metres need
MOST_LENGTH = 1e6  # of a quaternion that was not normalised
UNIT_TOLERANCE = 1e-3  # quaternions printed with four decimals stay within this of length one
MAX_KEY = (1 << 64) - 1


@dataclass(frozen=True, slots=True, eq=False)
class Vertex:
    """A first guess of a pose.

    Args:
        key: the whole number in the file.
        place: file and line.
        T_world_body: `(4, 4)`; not finite where the numbers are no pose.
    """

    key: int
    place: str
    T_world_body: FloatArray

    @property
    def is_known(self) -> bool:
        """Whether the guess is a pose."""
        return bool(np.isfinite(self.T_world_body).all())


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """A relative pose of two vertices.

    Args:
        first, second: keys of the poses that it joins.
        place: file and line.
        T_first_second: `(4, 4)`; not finite where `defect` says why.
        information: `(6, 6)`, rotation first; None where none is stated.
        defect: why it cannot be used; empty if it can.
        may_be_false: whether the file counts it among the loops that may be false; None where it does not say.
        is_false: whether the file labels it as false; None where it does not say.
        factor: what a JSON Robot Log calls it: robot, entry, measurement.
    """

    first: int
    second: int
    place: str
    T_first_second: FloatArray
    information: FloatArray | None
    defect: str = ""
    may_be_false: bool | None = None
    is_false: bool | None = None
    factor: tuple[str, int, int] | None = None


class Remarks:
    """Sentences for the user; of those alike only the first, because a converter's habit is in every line."""

    def __init__(self) -> None:
        self._first: dict[str, str] = {}
        self._count: Counter[str] = Counter()

    def add(self, kind: str, sentence: str, times: int = 1) -> None:
        """Takes a sentence in; `kind` tells which are alike."""
        if times:
            self._first.setdefault(kind, sentence)
            self._count[kind] += times

    def sentences(self) -> tuple[str, ...]:
        """The first of each kind, and how many more there are."""
        more = {kind: f" (and {n - 1} more like it)" if n > 1 else "" for kind, n in self._count.items()}
        return tuple(sentence + more[kind] for kind, sentence in self._first.items())


@dataclass(slots=True)
class FileRecords:
    """All that stands in one file.

    Args:
        path: the file.
        name: what a robot is called if only the file's name tells.
        vertices, edges: in the order of the file.
        ranges: robot, first and last key, where the file says so; its index counts from the first.
        owners: robot by key, where the file says so; its index is the key.
        ignored: how often each kind of line or measurement that is not used stands there.
        planar: whether all its poses lie in a plane.
        is_robot_log: whether it is a JSON Robot Log.
        title: what the file calls itself.
    """

    path: Path
    name: str
    vertices: list[Vertex] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    ranges: list[tuple[str, int, int]] = field(default_factory=list)
    owners: dict[int, str] = field(default_factory=dict)
    ignored: Counter[str] = field(default_factory=Counter)
    planar: bool = False
    is_robot_log: bool = False
    title: str = ""


def require_key(key: int, place: str) -> int:
    """The key itself.

    Raises:
        InputError: it does not fit 64 bits.
    """
    if not 0 <= key <= MAX_KEY:
        raise InputError(f"{place}: a key must be a number from 0 to 2^64 - 1, {str(key)[:30]} is not")
    return key


def transforms(rotation: Rotation, translation: FloatArray, usable: BoolArray) -> FloatArray:
    """`(N, 4, 4)`; rows that are not usable become NaN."""
    T = se3.from_rotation_translation(rotation.as_matrix(), translation)
    T[~usable] = np.nan
    return T


def from_quaternions(numbers: FloatArray) -> tuple[FloatArray, list[str]]:
    """Transforms `(N, 4, 4)` of rows `(N, 7)` x y z qx qy qz qw, and what is wrong with each, empty if nothing."""
    largest = np.abs(np.nan_to_num(numbers[:, 3:], posinf=0, neginf=0)).max(axis=1, initial=0.0)
    length = np.where(largest < UNIT_TOLERANCE / 2, "its quaternion is zero", "")
    defects = pose_defects(numbers, np.where(largest > MOST_LENGTH, "its quaternion is no rotation", length))
    usable = np.array([not d for d in defects], bool)
    quaternions = np.where(usable[:, None], numbers[:, 3:], [0.0, 0.0, 0.0, 1.0])
    return transforms(Rotation.from_quat(quaternions), numbers[:, :3], usable), defects


def from_planar(numbers: FloatArray) -> tuple[FloatArray, list[str]]:
    """Transforms `(N, 4, 4)` of rows `(N, 3)` x y theta, and what is wrong with each."""
    lifted = np.column_stack([numbers[:, :2], np.zeros(len(numbers)), np.zeros((len(numbers), 2)), numbers[:, 2]])
    return from_euler(lifted)


def from_euler(numbers: FloatArray) -> tuple[FloatArray, list[str]]:
    """Transforms `(N, 4, 4)` of rows `(N, 6)` x y z roll pitch yaw (turned about x, then y, then z)."""
    defects = pose_defects(numbers, np.full(len(numbers), ""))
    usable = np.array([not d for d in defects], bool)
    angles = np.where(usable[:, None], numbers[:, 3:], 0.0)
    return transforms(Rotation.from_euler("xyz", angles), numbers[:, :3], usable), defects


def pose_defects(numbers: FloatArray, others: np.ndarray) -> list[str]:
    """What is wrong with each row `(N, K)` of a pose, translation in the first three; else what `others (N,)` say."""
    finite = np.asarray(np.isfinite(numbers).all(axis=1))
    far = np.abs(np.where(finite[:, None], numbers[:, :3], 0.0)).max(axis=1, initial=0.0)
    return [
        "a number is not finite" if not fine else f"{m:.3g} m is no distance on Earth" if m > FURTHEST_M else str(other)
        for fine, m, other in zip(finite, far, others, strict=True)
    ]


def lifted_information(planar: FloatArray) -> FloatArray:
    """Information `(N, 6, 6)`, rotation first, of matrices `(N, 3, 3)` over x y theta.

    Planar poses have no error out of the plane; there they get what the plane has, which keeps the scale.
    """
    lifted = np.zeros((len(planar), 6, 6))
    inside = np.array([3, 4, 2])
    lifted[:, inside[:, None], inside] = planar
    lifted[:, 0, 0] = lifted[:, 1, 1] = planar[:, 2, 2]
    lifted[:, 5, 5] = 0.5 * (planar[:, 0, 0] + planar[:, 1, 1])
    return lifted
