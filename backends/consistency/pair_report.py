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
