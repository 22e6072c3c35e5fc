"""Where the estimate over all keyframes starts: odometry placed rigidly, or chordal initialisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wiclosure.backends.factor_graph.truncated_least_squares import truncated_cost
from wiclosure.backends.least_squares.chordal import chordal
from wiclosure.backends.least_squares.system import System
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.types import FloatArray


def better_starts(
    team: TeamArrays, system: System, groups: Sequence[Sequence[str]], rigid: Mapping[str, FloatArray], limit: float
) -> list[FloatArray]:
    """Node poses `(N, 4, 4)`: of odometry placed rigidly and chordal initialisation the one that costs less.

    First by the cost of all closures in full; then, if that is another, by that with each up to the squared distance
    `limit`, which false ones do not spoil.  Each group of connected robots by itself; the system, of odometry and all
    closures, holds its first robot's first keyframe, which stays where `rigid` has it.
    """
    robots, placed = team.robots, team.stacked(rigid)
    in_full, truncated = placed.copy(), placed.copy()
    relaxed, count = chordal(system, placed), len(robots.odometry)
    of_placed, of_relaxed = system.chi_squares(placed), system.chi_squares(relaxed)
    for group in groups:
        members = np.isin(robots.robot, [team.names.index(name) for name in group])
        inside = members[system.edges.first]
        if not inside[count:].any():
            continue
        known = int(inside[:count].sum())
        for start, up_to in ((in_full, np.inf), (truncated, limit)):
            if truncated_cost(of_relaxed[inside], known, up_to) < truncated_cost(of_placed[inside], known, up_to):
                start[members] = relaxed[members]
    return [in_full] if np.array_equal(in_full, truncated) else [in_full, truncated]
