"""Graduated non-convexity: which closures are inliers, and the estimate by them, from any start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wiclosure.backends.factor_graph.truncated_least_squares import truncated_cost, truncated_weights
from wiclosure.backends.least_squares.chordal import cheaper, chordal
from wiclosure.backends.least_squares.system import CONVERGED, FEW_STEPS, STEPS, System
from wiclosure.types import BoolArray, FloatArray

MU_GROWTH = 1.4  # of mu, as in the paper
MU_GROWTH_SETTLED = 4.0  # where the last step hardly moved the estimate
SETTLED = 0.1  # of the residual at the limit: what is hardly
MOST_GNC_STEPS = 150
ROUGHLY = 1e-3  # relative decrease of the cost that ends a step: other weights change it by more
MOST_IDLE = 0.2  # of a system's edges, of no weight: with more, a smaller one is ordered anew


def graduated(system: System, count: int, starts: Sequence[FloatArray], limit: float) -> tuple[BoolArray, FloatArray]:
    """Inliers `(M,)` among loops, and poses, by graduated non-convexity with truncated least squares.

    Yang et al., RA-L 2020; each step is a few of Gauss-Newton and goes on from the one before.  Where all residuals of
    the plain solution from one of the starts are within the limit, that is the answer; else the steps begin at that
    from the last start, and it is the answer where it costs less than what came of them.

    Args:
        system: `count` edges of odometry, which are known inliers, then the loops.
        count: of them.
        starts: node poses `(N, 4, 4)`.
        limit: squared distance from which a closure is an outlier.
    """
    ones = np.ones(len(system.edges))
    for start in starts:
        plain = poses = system.solved(start)
        chi_square = system.chi_squares(poses)[count:]
        if (chi_square <= limit).all():
            return np.ones(len(chi_square), bool), poses
    mu = limit / max(2.0 * float(chi_square.max()) - limit, limit)
    weighted = _Weighted(system)
    for _ in range(MOST_GNC_STEPS):
        weights = truncated_weights(chi_square, limit, mu)
        if not weights[chi_square > limit].any():  # none is undecided: mu only brings the others to full weight
            break
        poses = weighted.solved(poses, np.concatenate([ones[:count], weights]), FEW_STEPS, ROUGHLY)
        before, chi_square = chi_square, system.chi_squares(poses)[count:]
        mu *= MU_GROWTH_SETTLED if _moved(before, chi_square, limit) < SETTLED else MU_GROWTH
    poses = weighted.solved(poses, np.concatenate([ones[:count], chi_square <= limit]))
    best = min((poses, plain), key=lambda found: truncated_cost(system.chi_squares(found), count, limit))
    return system.chi_squares(best)[count:] <= limit, best


class _Weighted:
    """A system under weights that change.

    Outliers that lose their weight have bent the poses: the way back from there is long, or leads elsewhere.  Chordal
    initialisation under the same weights goes before, where it costs less.
    """

    def __init__(self, system: System) -> None:
        self.system, self.part, self.held = system, system, np.ones(len(system.edges), bool)

    def solved(
        self, poses: FloatArray, weights: FloatArray, steps: int = STEPS, converged: float = CONVERGED
    ) -> FloatArray:
        """Poses `(N, 4, 4)` after `System.descent`, under the weights `(M,)`."""
        used = weights > 0
        if (used & ~self.held).any() or used.sum() < (1.0 - MOST_IDLE) * self.held.sum():
            self.part, self.held = self.system.subset(used), used
        w = weights[self.held]
        start = cheaper(self.part, poses, chordal(self.part, poses, w), w)
        return self.part.starting(start).descent(start, w, steps, converged).poses


def _moved(before: FloatArray, after: FloatArray, limit: float) -> float:
    """Largest change of a residual among the better half of the loops, as a share of the residual at the limit."""
    better = before <= np.median(before)
    return float(np.abs(np.sqrt(after) - np.sqrt(before))[better].max() / np.sqrt(limit))
