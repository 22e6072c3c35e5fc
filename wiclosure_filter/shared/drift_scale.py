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
from wiclosure.wiclosure_filter.shared.joint_covariance import JointCovariance


def drift_scale(
    odometry: gtsam.NonlinearFactorGraph,
    others: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    covariance: JointCovariance,
    *,
    robots: int,
    prior_weight: float,
) -> float:
    """Factor on the standard deviations of the drift model.

    A step of the fixed-point iteration, and meant to be the last one where it makes the drift smaller: links are heard
    where robots are near each other, and the odometry may be worse where they are not.

    Args:
        odometry: factors between neighbouring nodes, as the drift model has them.
        others: links, headings, and one prior for each robot.
        values: the optimum of both together, with the drift scaled as far as is known by now.
        covariance: of all nodes at that optimum.
        robots: whose frames are estimated; their 6 parameters each are not odometry.
        prior_weight: determined parameters that the drift model counts as.
    """
    squared = 2.0 * odometry.error(values)
    linear = others.linearize(values)
    determined = sum(_determined(linear.at(i), covariance) for i in range(linear.size())) - 6 * robots
    return float(np.sqrt((prior_weight + squared) / (prior_weight + max(determined, 0.0))))


def _determined(factor: gtsam.GaussianFactor, covariance: JointCovariance) -> float:
    """How much of a factor's measurement is a surprise no more: trace of `J C J^T`, at most its dimension."""
    J, _ = factor.jacobian()
    keys = factor.keys()
    if len(keys) == 1:
        return float(np.trace(J @ covariance.own[keys[0]] @ J.T))
    seen: FloatArray = sum(
        (J[:, 6 * n : 6 * n + 6] @ covariance.factor[key] for n, key in enumerate(keys)),
        np.zeros((len(J), covariance.factor.shape[2])),
    )
    return float(np.sum(seen**2))
