"""What the consistency check found between two robots, for the user."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PairConsistency:
    """What the consistency check found between two robots.

    Args:
        robot_a, robot_b: the robots; the same name twice for closures within one robot.
        considered: closures that were checked.
        kept: how many were accepted.
        largest: size of the largest consistent set.
        contradicting: size of the largest set that contradicts it.
        proven: false if the time ran out before a larger set was excluded.
        ambiguous: that set is nearly as large, so that neither is accepted.
        sentence: the same for the user.
        rival: size of the largest set that contradicts what is accepted, here or of robots between, and is at least
            half as strong (`CandidateSet.strength`), where nothing else speaks against it; 0 without one.
    """

    robot_a: str
    robot_b: str
    considered: int
    kept: int
    largest: int
    contradicting: int
    proven: bool
    ambiguous: bool
    sentence: str
    rival: int = 0

    @property
    def doubt(self) -> str:
        """That the map may be wrong, for the user; empty where nothing says so."""
        if not self.rival:
            return ""
        name = self.robot_a if self.robot_a == self.robot_b else f"{self.robot_a} and {self.robot_b}"
        if not self.kept:
            return (
                f"{name}: the map may be wrong: {self.rival} closures agree with each other, but contradict accepted"
                " ones that join these robots over others and are hardly better supported, as where places look alike;"
                " nothing tells which are true"
            )
        return (
            f"{name}: the map may be wrong: {self.kept} closures agree with each other and are"
            f" accepted, but {self.rival} others agree as well and contradict them, as where places look alike; nothing"
            " tells which are true"
        )


def doubt_of_neighbours(robot_a: str, robot_b: str) -> str:
    """That closures are accepted which contradict their neighbours, for the user."""
    where = f"within {robot_a}" if robot_a == robot_b else f"between {robot_a} and {robot_b}"
    return (
        f"the map may be wrong: closures {where} are accepted that contradict neighbouring ones far more than others"
        " do, as where places look alike; nothing tells which are true"
    )
