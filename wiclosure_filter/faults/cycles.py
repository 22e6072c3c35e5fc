"""Three robots or more check each other: alignments around a cycle must add up to none.

From a to b, on to c, and back to a, wrong alignments do not end where they began.  So two that are certain judge the
third: of the readings that its measurements cannot tell apart, those that do not close the cycle are refuted.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from scipy.special import chdtri

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, FloatArray, FrameAlignment, Trajectory
from wiclosure.wiclosure_filter.links.links import Links

RobotPair: TypeAlias = tuple[str, str]

# Chi-square of yaw and place up to which a cycle closes, and from which it does not (four standard deviations).
_CLOSES, _CONTRADICTS = float(chdtri(3, 0.001)), float(chdtri(3, 6.3e-5))


def _triangles(robots: Sequence[str], pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str, str]]:
    """Three robots each of which all pairs are given, in order; a large team has few of all that there could be."""
    order = {robot: number for number, robot in enumerate(robots)}
    later: dict[str, set[str]] = defaultdict(set)
    for a, b in pairs:
        later[a].add(b)
    found = [(a, b, c) for a, after_a in list(later.items()) for b in after_a for c in after_a & later.get(b, set())]
    return sorted(found, key=lambda cycle: [order[robot] for robot in cycle])


@dataclass(frozen=True, eq=False)
class Cycles:
    """What other robots say of how two of them lie.

    Args:
        alignments: by pair of robots, a before b in the order of the trajectories.
        links: of each pair.
        trajectories: of all robots.
        inflation: factor on the odometry's standard deviations.
    """

    alignments: Mapping[RobotPair, FrameAlignment]
    links: Mapping[RobotPair, Links]
    trajectories: Mapping[str, Trajectory]
    inflation: float

    def contradictions(self) -> dict[RobotPair, str]:
        """Certain alignments that do not add up around a cycle of three, with a sentence each."""
        found: dict[RobotPair, str] = {}
        certain = {pair: alignment for pair, alignment in self.alignments.items() if not alignment.ambiguous}
        for a, b, c in _triangles(list(self.trajectories), certain):
            best = certain[a, b].best
            assert best is not None  # it is certain
            off, chi2 = self._gap(c, certain[a, b], best)
            if chi2 > _CONTRADICTS:
                metres, degrees = np.hypot(*off[1:]), np.degrees(abs(off[0]))
                sentence = (
                    f"the alignments of {a}, {b} and {c} contradict each other by {metres:.0f} m and {degrees:.0f}"
                    f" degrees (chi-square {chi2:.0f} of three numbers)"
                )
                found |= dict.fromkeys(((a, b), (b, c), (a, c)), sentence)
        return found

    def without_refuted_readings(self, min_odds: float) -> dict[RobotPair, FrameAlignment]:
        """Alignments that are certain after all: a third robot refutes every blunder that would fit as well.

        It must leave these odds against each, however rare such a blunder is.
        """
        found = {}
        for pair, alignment in self.alignments.items():
            if not alignment.only_blunders:
                continue
            for third in self.trajectories:
                sides = [_ordered(robot, third, self.trajectories) for robot in pair]
                judged = third not in pair and all(self._certain(side) for side in sides)
                if judged and self._refutes(third, alignment, min_odds):
                    found[pair] = alignment.certain_after_all(f"{third} rules out that the log is wrong")
                    break
        return found

    def _certain(self, pair: RobotPair) -> bool:
        return pair in self.alignments and not self.alignments[pair].ambiguous

    def _refutes(self, third: str, alignment: FrameAlignment, min_odds: float) -> bool:
        """Whether the cycle through a third robot closes by what the log claims, and by no other reading."""
        assert alignment.best is not None  # it has likely alternatives
        readings = (alignment.best, *alignment.likely_alternatives)
        chi2 = np.array([self._gap(third, alignment, reading)[1] for reading in readings])
        gained = np.array([reading.log_likelihood for reading in readings]) - readings[0].log_likelihood
        against = (chi2 - chi2[0]) / 2 - np.maximum(gained, 0.0)
        return bool(chi2[0] < _CLOSES and (against[1:] > np.log(min_odds)).all())

    def _gap(self, third: str, alignment: FrameAlignment, reading: AlignmentHypothesis) -> tuple[FloatArray, float]:
        """By how much two robots lie otherwise than through the third, where they heard each other.

        Yaw, x and y, and the chi-square of these.
        """
        a, b = alignment.robot_a, alignment.robot_b
        (at_a, at_b), (a_third, third_a) = self._middle((a, b)), self._met(a, third)
        b_third, third_b = self._met(b, third)
        way = [
            self._moved(a, at_a, a_third),
            self._between(a, third),
            self._moved(third, third_a, third_b),
            self._between(third, b),
            self._moved(b, b_third, at_b),
        ]
        T, C = np.eye(4), np.zeros((6, 6))
        for T_step, C_step in way:
            T, C = T @ T_step, se3.compose_covariance(C, T_step, C_step)
        T_a_b, C_direct = self._at_meeting(replace(alignment, best=reading))
        off = se3.log(se3.inverse(T) @ T_a_b)[2:5]
        return off, float(off @ np.linalg.solve((C + C_direct)[2:5, 2:5], off))

    def _middle(self, pair: RobotPair) -> tuple[int, int]:
        """Keyframes of both in the middle of the time in which they heard each other."""
        links = self.links[pair]
        row = np.argsort(links.stamp_a_ns, kind="stable")[len(links) // 2]
        return int(links.index_a[row]), int(links.index_b[row])

    def _met(self, robot: str, other: str) -> tuple[int, int]:
        """The same, the keyframe of the first first."""
        pair = _ordered(robot, other, self.trajectories)
        at = self._middle(pair)
        return at if pair[0] == robot else at[::-1]

    def _moved(self, robot: str, since: int, until: int) -> tuple[FloatArray, FloatArray]:
        """A robot's motion between keyframes `(4, 4)`, and its covariance `(6, 6)`."""
        trajectory = self.trajectories[robot]
        (covariance,) = trajectory.relative_covariance(np.array([since]), np.array([until]))
        T = se3.between(trajectory.poses[since], trajectory.poses[until])
        return T, self.inflation**2 * covariance

    def _between(self, robot: str, other: str) -> tuple[FloatArray, FloatArray]:
        """From a robot to another where they heard each other."""
        pair = _ordered(robot, other, self.trajectories)
        T, C = self._at_meeting(self.alignments[pair])
        return (T, C) if pair[0] == robot else (se3.inverse(T), se3.inverse_covariance(T, C))

    def _at_meeting(self, alignment: FrameAlignment) -> tuple[FloatArray, FloatArray]:
        """`T_a_b` of two keyframes in the middle of the meeting, by an alignment, and its covariance."""
        assert alignment.best is not None
        assert alignment.covariance is not None
        a, b = alignment.robot_a, alignment.robot_b
        at_a, at_b = self._middle((a, b))
        pose_a, pose_b = self.trajectories[a].poses[at_a], self.trajectories[b].poses[at_b]
        T = se3.inverse(pose_a) @ alignment.best.T_a_b @ pose_b
        return T, se3.rotate_covariance(se3.adjoint(se3.inverse(pose_b)), alignment.covariance)


def _ordered(robot: str, other: str, trajectories: Mapping[str, Trajectory]) -> RobotPair:
    order = list(trajectories)
    return (robot, other) if order.index(robot) < order.index(other) else (other, robot)
