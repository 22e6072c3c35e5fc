"""Drift scale estimated from the links: how much better or worse the odometry is than its drift model.

One drift model serves every place and sensor, yet real drift differs severalfold between recordings.  The joint
estimate knows: odometry residuals larger than expected mean that links had to bend it.  With r their sum of squares in
standard deviations and g the number of odometry parameters that the links determine, the most likely scale of the
drift's variance is r / g (MacKay, Bayesian Interpolation, 1992, eq. 4.4 and 4.9).
"""

from __future__ import annotations

import gtsam
import numpy as np

from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.covariance.square_root import SquareRoot


def drift_scale(
    odometry: gtsam.NonlinearFactorGraph,
    steps: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    root: SquareRoot,
    *,
    robots: int,
    prior_weight: float,
) -> float:
    """Factor on the standard deviations of the drift model.

    A step of the fixed-point iteration, and meant to be the last one where it makes the drift smaller: links are heard
    where robots are near each other, and the odometry may be worse where they are not.

    Of all parameters the odometry determines as many as its measurements are a surprise no more, the trace of
    `J C J^T`; the links, headings and one prior for each robot determine the others.

    Args:
        odometry: factors between neighbouring nodes, as the drift model has them.
        steps: the same as the estimate has them, with the drift scaled as far as is known by now.
        values: the optimum of these and all other factors.
        root: of the information of all nodes at that optimum.
        robots: whose frames are estimated; their 6 parameters each are not odometry.
        prior_weight: determined parameters that the drift model counts as.
    """
    squared = 2.0 * odometry.error(values)
    node = np.arange(len(root.clique_of))
    own, following = root.near(node[:-1], node[1:])
    determined = 6 * len(own) - _determined(steps.linearize(values), own, following) - 6 * robots
    return float(np.sqrt((prior_weight + 2.0 + squared) / (prior_weight + max(determined, 0.0))))


def _determined(steps: gtsam.GaussianFactorGraph, own: FloatArray, following: FloatArray) -> float:
    """How much of the steps' measurements is a surprise no more: trace of `J C J^T`."""
    factors = [steps.at(number) for number in range(steps.size())]
    J = np.array([factor.jacobian()[0] for factor in factors]).reshape(-1, 6, 12)
    n = np.array([factor.keys()[0] for factor in factors], np.int64)
    of_first, of_second = J[..., :6], J[..., 6:]
    squared = [(of_first @ own[n], of_first), (of_second @ own[n + 1], of_second)]
    mixed = (2.0 * of_first @ following[n], of_second)
    return float(sum(np.sum(left * right) for left, right in (*squared, mixed)))
