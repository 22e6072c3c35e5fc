"""Which of two robots slipped, where a third robot or a jump of its own odometry tells; two alone do not tell.

A robot whose alignment with a third one holds from before the slip to after it did not slip then.  And a step twice as
fast as any other of a robot's way is no drive but a jump of its odometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from wiclosure.types import FrameAlignment, Trajectory
from wiclosure.wiclosure_filter.links.links import Links

RobotPair: TypeAlias = tuple[str, str]
Stretch: TypeAlias = tuple[int, int]  # ns

_JUMP = 2.0  # times as fast as any other step


@dataclass(frozen=True, eq=False)
class Slips:
    """Pairs of robots of which one slipped.

    Args:
        alignments: of all pairs.
        links: of each pair.
        trajectories: of all robots.
    """

    alignments: Mapping[RobotPair, FrameAlignment]
    links: Mapping[RobotPair, Links]
    trajectories: Mapping[str, Trajectory]

    def told(self) -> dict[RobotPair, FrameAlignment]:
        """Those alignments of which it is told who slipped, with its name."""
        found = {}
        for pair, alignment in self.alignments.items():
            if alignment.slip_ns is None:
                continue
            who, why = self._who(pair, alignment.slip_ns)
            if who:
                reason = f"it was {who}: {why}; {alignment.reason}"
                found[pair] = replace(alignment, slipped_robot=who, reason=reason)
        return found

    def _who(self, pair: RobotPair, slip_ns: Stretch) -> tuple[str, str]:
        """The robot and why; empty where nothing tells, or what tells disagrees."""
        jumps = {robot: jump(self.trajectories[robot], slip_ns) for robot in pair}
        jumped = [robot for robot in pair if jumps[robot]]
        held = {robot: self._held_with(robot, pair, slip_ns) for robot in pair}
        moved = [robot for robot in pair if not held[robot]]
        if len(jumped) == 1 and jumped[0] in moved:
            return jumped[0], jumps[jumped[0]]
        if not jumped and len(moved) == 1:
            (stayed,) = set(pair) - set(moved)
            return moved[0], f"{stayed} and {held[stayed]} lie the same before and after"
        return "", ""

    def _held_with(self, robot: str, pair: RobotPair, slip_ns: Stretch) -> str:
        """A third robot with which one has a certain alignment by links before and after; or empty."""
        for other, alignment in self.alignments.items():
            if alignment.ambiguous or robot not in other or set(other) == set(pair):
                continue
            stamps_ns = self.links[other].stamp_a_ns
            if stamps_ns.min() <= slip_ns[0] and stamps_ns.max() >= slip_ns[1]:
                return other[0] if other[1] == robot else other[1]
        return ""


def jump(trajectory: Trajectory, stretch_ns: Stretch) -> str:
    """That odometry jumps within a stretch of time, as a clause; empty where it does not."""
    every = trajectory if trajectory.finer is None else trajectory.finer
    step_m = np.linalg.norm(np.diff(every.positions, axis=0), axis=1)
    speed = step_m / (np.diff(every.stamps_ns) / 1e9)
    if len(speed) < 2:
        return ""
    last, fastest = np.argsort(speed)[-2:]
    within = every.stamps_ns[fastest + 1] >= stretch_ns[0] and every.stamps_ns[fastest] <= stretch_ns[1]
    short = step_m[fastest] <= _JUMP * np.delete(step_m, fastest).max()  # then it may be the stamps that are uneven
    if short or not within or speed[fastest] <= _JUMP * speed[last]:
        return ""
    return f"its odometry jumps at {speed[fastest]:.1f} m/s, and is no faster than {speed[last]:.1f} m/s otherwise"
