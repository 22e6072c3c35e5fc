"""Where the estimate over all keyframes starts: odometry placed rigidly, or chordal initialisation."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.edges import System
from wiclosure.backends.least_squares.settling import truncated_cost
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.types import FloatArray

logger = logging.getLogger(__name__)


def better_starts(
    team: TeamArrays, groups: Sequence[Sequence[str]], rigid: Mapping[str, FloatArray], limit: float
) -> list[FloatArray]:
    """Node poses `(N, 4, 4)`: of odometry placed rigidly and chordal initialisation the one that costs less.

    First by the cost of all closures in full; then, if that is another, by that with each up to the squared distance
    `limit`, which false ones do not spoil.  Each group of connected robots by itself; its first robot's first keyframe
    stays where `rigid` has it.
    """
    robots, chordal = team.robots, team.stacked(rigid)
    in_full, truncated = chordal.copy(), chordal.copy()
    edges, nothing_held = robots.odometry + robots.loops, np.zeros(0, np.int64)
    system, count = System.of(edges, len(chordal), nothing_held), len(robots.odometry)
    for group in groups:
        members = np.isin(robots.robot, [team.names.index(name) for name in group])
        inside = members[edges.first]
        if not inside[count:].any():
            continue
        root = int(robots.first_nodes[team.names.index(group[0])])
        found = _chordal(team, np.flatnonzero(inside), root, chordal[root])
        if found is None:
            continue
        chordal[members] = found[members]
        known = int(inside[:count].sum())
        distances = [system.chi_squares(poses)[inside] for poses in (in_full, chordal)]
        for start, up_to in ((in_full, np.inf), (truncated, limit)):
            of_rigid, of_chordal = (truncated_cost(squared, known, up_to) for squared in distances)
            if of_chordal < of_rigid:
                start[members] = chordal[members]
    return [in_full] if np.array_equal(in_full, truncated) else [in_full, truncated]


def _chordal(team: TeamArrays, rows: np.ndarray, root: int, T_world_root: FloatArray) -> FloatArray | None:
    """Node poses by relaxing rotations, then positions (Carlone et al., ICRA 2015); None where that fails."""
    edges = (team.robots.odometry + team.robots.loops).subset(rows)
    graph = gtsam.NonlinearFactorGraph()
    unit = gtsam.noiseModel.Isotropic.Sigma(6, 1.0)
    sigmas = np.sqrt(np.diagonal(edges.covariance, axis1=1, axis2=2))
    for first, second, T, sigma in zip(edges.first.tolist(), edges.second.tolist(), edges.T, sigmas, strict=True):
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigma)
        graph.add(gtsam.BetweenFactorPose3(first, second, gtsam.Pose3(T), noise))
    graph.add(gtsam.PriorFactorPose3(root, gtsam.Pose3(T_world_root), unit))
    try:
        values = gtsam.InitializePose3.initialize(graph)
    except RuntimeError:  # GTSAM's own, thrown for indeterminate systems
        logger.debug("chordal initialisation failed", exc_info=True)
        return None
    found = np.tile(np.eye(4), (len(team.robots.robot), 1, 1))
    nodes = np.unique(np.concatenate([edges.first, edges.second]))
    found[nodes] = np.stack([values.atPose3(int(n)).matrix() for n in nodes])
    found[nodes] = T_world_root @ se3.inverse(found[root]) @ found[nodes]
    return found if np.isfinite(found).all() else None
