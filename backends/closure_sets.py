"""Closures as arrays: brought into one direction, checked, and grouped by pairs of robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise
from wiclosure.errors import InputError
from wiclosure.types import BoolArray, Closure, FloatArray, IntArray, KeyframeId, Stage, Trajectory, measured_poses


class Decision(NamedTuple):
    """What a stage decides on one closure, and why."""

    accepted: bool
    reason: str


@dataclass(frozen=True, eq=False)
class ClosureSet:
    """The closures between two robots, all from the first to the second (or within one: from early to late).

    Args:
        robot_a, robot_b: the robots; the same name twice for closures within one robot.
        rows: `(N,)` positions in the list that the closures came from.
        index_a, index_b: `(N,)` keyframe indices.
        T_a_b: `(N, 4, 4)` measured pose of b's body in a's body.
        covariance: `(N, 6, 6)` of `T_a_b`, noise floor included.
        turned: `(N,)` those that were stated the other way round; None: nobody knows.
    """

    robot_a: str
    robot_b: str
    rows: IntArray
    index_a: IntArray
    index_b: IntArray
    T_a_b: FloatArray
    covariance: FloatArray
    turned: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def name(self) -> str:
        """For the user: `alpha and beta`, or `alpha with itself`."""
        return (
            " and ".join(sorted((self.robot_a, self.robot_b))) if self.between_robots else f"{self.robot_a} with itself"
        )

    @property
    def between_robots(self) -> bool:
        """False for closures within one robot."""
        return self.robot_a != self.robot_b

    def subset(self, kept: IntArray) -> Self:
        """The closures at `kept`, boolean or indices."""
        return type(self)(
            self.robot_a,
            self.robot_b,
            self.rows[kept],
            self.index_a[kept],
            self.index_b[kept],
            self.T_a_b[kept],
            self.covariance[kept],
            None if self.turned is None else self.turned[kept],
        )

    def covariance_parts(self) -> FloatArray:
        """`(3, N, 6, 6)` of `covariance`, what comes of the stated ones' parts (`covariance_parts`)."""
        turned = np.zeros(len(self), bool) if self.turned is None else self.turned
        stated, T = self.covariance.copy(), self.T_a_b[turned]
        stated[turned] = se3.inverse_covariance(T, stated[turned])
        parts = covariance_parts(stated)
        parts[:, turned] = np.stack([se3.inverse_covariance(se3.inverse(T), part) for part in parts[:, turned]])
        return parts


def covariance_parts(covariance: FloatArray) -> FloatArray:
    """`(3, N, 6, 6)`: rotation's own part, that which it shares with translation, and translation's own.

    Turned or chained, rotations move positions: only as they are stated can rotation and translation be told apart.
    """
    rotation, translation = np.zeros_like(covariance), np.zeros_like(covariance)
    rotation[:, :3, :3], translation[:, 3:, 3:] = covariance[:, :3, :3], covariance[:, 3:, 3:]
    return np.stack([rotation, covariance - rotation - translation, translation])


def closure_sets(
    closures: Sequence[Closure], trajectories: Mapping[str, Trajectory], noise: ClosureNoise
) -> tuple[list[ClosureSet], dict[int, str]]:
    """Groups the live closures (measured, and not rejected so far) by pairs of robots.

    Which robot comes first depends on how it started and not on its name or place, so that renamed or reordered robots
    get the same answer to the last digit.

    Returns:
        The sets, and the reason for each row whose measurement cannot be used.

    Raises:
        InputError: a closure names a robot or a keyframe that the trajectories do not have.
    """
    robots = canonical_order(trajectories)
    order = {robot: rank for rank, robot in enumerate(robots)}
    live = [row for row, closure in enumerate(closures) if closure.measured is not None and closure.live]
    for row in live:
        for end in (closures[row].query, closures[row].match):
            _check_keyframe(end, trajectories)
    defects = _defects([closures[row] for row in live])
    rows: dict[tuple[int, int], list[int]] = {}
    unusable: dict[int, str] = {}
    for row, reason in zip(live, defects, strict=True):
        if reason:
            unusable[row] = reason
            continue
        a, b = sorted((order[closures[row].query.robot], order[closures[row].match.robot]))
        rows.setdefault((a, b), []).append(row)
    return [_stacked(robots[a], robots[b], rows[a, b], closures, noise) for a, b in sorted(rows)], unusable


def decided(closures: Sequence[Closure], stage: Stage, decisions: Mapping[int, Decision]) -> list[Closure]:
    """The closures in their order, as a stage leaves them that decided on some rows."""
    result = list(closures)
    for row, (accepted, reason) in decisions.items():
        result[row] = result[row].accepted(stage, reason) if accepted else result[row].rejected(stage, reason)
    return result


def canonical_order(trajectories: Mapping[str, Trajectory]) -> list[str]:
    """The robots in an order that depends on how each started, and not on names, frames or the order given."""
    return sorted(trajectories, key=lambda robot: _first_step(trajectories[robot]))


def _first_step(trajectory: Trajectory) -> list[float]:
    """Tells robots apart in any odometry frame and at any time, rounded so that rounding errors do not."""
    second = min(1, len(trajectory) - 1)
    step = se3.log(se3.between(trajectory.poses[0], trajectory.poses[second]))
    return [float(number) for number in np.round(step, 9)]


def _check_keyframe(key: KeyframeId, trajectories: Mapping[str, Trajectory]) -> None:
    if key.robot not in trajectories:
        raise InputError(
            f"closure of unknown robot {key.robot!r}; trajectories are given for {', '.join(trajectories)}"
        )
    if not 0 <= key.index < len(trajectories[key.robot]):
        raise InputError(
            f"closure of keyframe {key.index} of {key.robot}, which has {len(trajectories[key.robot])} keyframes;"
            " pass the keyframe trajectories that the closures were made from"
        )


def _defects(closures: Sequence[Closure]) -> list[str]:
    """Why each measurement cannot be used; empty if it can."""
    T, covariance = measured_poses(closures)
    finite = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    smallest = np.linalg.eigvalsh(np.where(finite[:, None, None], covariance, 0.0))[:, 0]
    reasons = {
        "closes a keyframe on itself": np.array([c.query == c.match for c in closures], bool),
        "its transform is not finite": np.asarray(~np.isfinite(T).all(axis=(1, 2))),
        "its covariance is not finite": np.asarray(~finite),
        "its covariance is not positive": np.asarray(smallest < 0),
    }
    return [next((r for r, holds in reasons.items() if holds[n]), "") for n in range(len(closures))]


def _stacked(
    robot_a: str, robot_b: str, rows: list[int], closures: Sequence[Closure], noise: ClosureNoise
) -> ClosureSet:
    chosen = [closures[row] for row in rows]
    query, match = np.array([[c.query.index, c.match.index] for c in chosen], dtype=np.int64).T
    T, covariance = (part.astype(float) for part in measured_poses(chosen))
    covariance = covariance + np.diag(np.repeat([noise.rotation_rad**2, noise.translation_m**2], 3))
    turned = query > match if robot_a == robot_b else np.array([c.query.robot != robot_a for c in chosen])
    covariance[turned] = se3.inverse_covariance(T[turned], covariance[turned])
    T[turned] = se3.inverse(T[turned])
    index_a, index_b = np.where(turned, match, query), np.where(turned, query, match)
    return ClosureSet(robot_a, robot_b, np.array(rows, dtype=np.int64), index_a, index_b, T, covariance, turned)
