"""Graduated non-convexity: which closures are inliers, and the estimate by them, from any start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wiclosure.backends.factor_graph.truncated_least_squares import truncated_cost, truncated_weights
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.system import System
from wiclosure.types import BoolArray, FloatArray, IntArray

MU_GROWTH = 1.4  # of mu
MOST_GNC_STEPS = 150
NEWTON_STEPS = 5  # of Gauss-Newton while mu stays


def graduated(
    odometry: Edges, loops: Edges, starts: Sequence[FloatArray], held: IntArray, limit: float
) -> tuple[BoolArray, FloatArray]:
    """Inliers `(M,)` among loops, and poses, by graduated non-convexity with truncated least squares.

    Yang et al., RA-L 2020; each step is a few of Gauss-Newton and goes on from the one before.  Where all residuals of
    the plain solution from one of the starts are within the limit, that is the answer; else the steps begin at that
    from the last start, and it is the answer where it costs less than what came of them.
    """
    system, count = System.of(odometry + loops, starts[0], held), len(odometry)
    for start in starts:
        plain = poses = system.solved(start)
        chi_square = system.chi_squares(poses)[count:]
        if (chi_square <= limit).all():
            return np.ones(len(loops), bool), poses
    mu = limit / max(2.0 * float(chi_square.max()) - limit, limit)
    for _ in range(MOST_GNC_STEPS):
        weights = truncated_weights(chi_square, limit, mu)
        if not weights[chi_square > limit].any():  # none is undecided: mu only brings the others to full weight
            break
        poses = system.solved(poses, np.concatenate([np.ones(count), weights]), steps=NEWTON_STEPS)
        chi_square = system.chi_squares(poses)[count:]
        mu *= MU_GROWTH
    poses = system.solved(poses, np.concatenate([np.ones(count), chi_square <= limit]))
    best = min((poses, plain), key=lambda found: truncated_cost(system.chi_squares(found), count, limit))
    return system.chi_squares(best)[count:] <= limit, best
