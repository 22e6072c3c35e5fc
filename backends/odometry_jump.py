"""A step of odometry that closures contradict: what it is, and what is said of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.types import FloatArray, Trajectory


@dataclass(frozen=True, eq=False)
class Jump:
    """A step of odometry that closures contradict.

    Args:
        node: the first behind it.
        error: `(6,)` tangent vector from what odometry says of the step to what closures do.
        stretch: the last node before it and the first behind it that have accepted closures: it may be between any two.
    """

    node: int
    error: FloatArray
    stretch: tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class OdometryJump:
    """A step of a robot's odometry that is not believed.

    Args:
        robot: its name.
        index: the keyframe behind it.
        error: `(6,)` tangent vector from what odometry says of the step to what closures do.
    """

    robot: str
    index: int
    error: FloatArray

    @classmethod
    def of_team(cls, team: TeamArrays, jump: Jump, trajectories: Mapping[str, Trajectory]) -> OdometryJump:
        """In the names and keyframes of a team; of the steps that it may be, that which leaves the shortest path."""
        robot, first = int(team.robots.robot[jump.node]), team.robots.first_nodes
        nodes, trajectory = team.nodes[team.names[robot]], trajectories[team.names[robot]]
        odometry, step = team.robots.odometry, team.robots.steps_across(jump.node)
        ends = (odometry.first[step][0], jump.node) if trajectory.parents is not None else jump.stretch
        before, after, node = (int(nodes[n - first[robot]]) for n in (*ends, jump.node))
        rows = [before, after] if trajectory.parents is not None else slice(before, after + 1)
        T, T_node = trajectory.poses[rows], trajectory.poses[node]
        behind = T_node @ se3.exp(jump.error) @ se3.inverse(T_node) @ T[1:]  # by closures
        stated, corrected = se3.between(T[:-1], T[1:]), se3.between(T[:-1], behind)
        longer = np.linalg.norm(corrected[:, :3, 3], axis=1) - np.linalg.norm(stated[:, :3, 3], axis=1)
        best = int(np.argmin(longer))
        error = se3.log(se3.between(stated[best], corrected[best])[None])[0]
        return cls(team.names[robot], after - (len(T) - 2) + best, error)

    @property
    def covariance(self) -> FloatArray:
        """`(6, 6)` under which the jump is one sigma, in whatever direction."""
        return np.diag(np.repeat([np.sum(part**2) for part in (self.error[:3], self.error[3:])], 3))

    @property
    def size(self) -> str:
        """In metres and degrees."""
        metres, degrees = np.linalg.norm(self.error[3:]), np.degrees(np.linalg.norm(self.error[:3]))
        return f"{metres:.1f} m and {degrees:.0f} degrees"

    @property
    def doubt(self) -> str:
        """Where it is not believed, for the user."""
        return (
            f"the map may be wrong: its closures fit far better if the odometry of {self.robot} jumps by {self.size}"
            f" between its keyframes {self.index - 1} and {self.index}, but false closures or a jump"
            " elsewhere would explain as much; nothing tells which"
        )

    @property
    def sentence(self) -> str:
        """For the user."""
        return (
            f"the odometry of {self.robot} jumps by {self.size} between its keyframes"
            f" {self.index - 1} and {self.index}: closures on both sides tell, and it is not believed there"
        )
