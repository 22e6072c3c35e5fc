"""How fast odometry goes wrong: a drift model, and what it says of any two poses of one trajectory.

Two kinds of error are added along the path.  *Random walk*: independent from step to step, its standard deviation grows
with the square root of the distance.  *Bias*: one unknown constant for the whole trajectory (scale, a gyroscope's or a
calibration's yaw rate), its effect grows with the distance.  Both are kept as prefix sums in the odometry frame, so the
covariance between any two poses costs the same however far they are apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from wiclosure import se3
from wiclosure.se3 import FloatArray
from wiclosure.settings import Settings


class DriftModel(Settings):
    """Standard deviations of odometry errors, along the path travelled.

    The defaults are fitted to real KISS-ICP trajectories against ground truth (`benchmarks/drift.py`), where biases did
    not raise the likelihood.
    """

    translation_walk: float = Field(0.046, gt=0, description="m per square root of a metre travelled, each axis")
    rotation_walk: float = Field(0.00052, gt=0, description="rad per square root of a metre travelled, each axis")
    rotation_walk_turning: float = Field(0.0029, ge=0, description="rad per square root of a radian turned, each axis")
    translation_bias: float = Field(0.0, ge=0, description="m per metre travelled: scale and side slip")
    rotation_bias: float = Field(0.0, ge=0, description="rad per metre travelled: a constant turn rate")


@dataclass(frozen=True, eq=False)
class AccumulatedDrift:
    """Prefix sums of a drift model along one trajectory of N poses.

    Args:
        walk: `(N, 6, 6)`, sum of `Ad(T_k) Q_k Ad(T_k)^T` over the steps up to each pose, in the odometry frame.
        bias: `(N, 6, 6)`, sum of `Ad(T_k) ds_k` over the steps up to each pose.
        bias_sigma: `(6,)`, standard deviations of the constant error per metre.
    """

    walk: FloatArray
    bias: FloatArray
    bias_sigma: FloatArray

    @classmethod
    def along(cls, T_odom_body: FloatArray, drift: DriftModel) -> AccumulatedDrift:
        """Accumulates `drift` over the poses `(N, 4, 4)` of one trajectory."""
        step = se3.between(T_odom_body[:-1], T_odom_body[1:])
        length = np.linalg.norm(step[:, :3, 3], axis=1)
        variance = np.empty((len(step), 6))
        variance[:, :3] = (drift.rotation_walk**2 * length + drift.rotation_walk_turning**2 * se3.rotation_angle(step))[
            :, None
        ]
        variance[:, 3:] = (drift.translation_walk**2 * length)[:, None]
        Ad = se3.adjoint(T_odom_body[1:])
        walk = np.zeros((len(T_odom_body), 6, 6))
        bias = np.zeros((len(T_odom_body), 6, 6))
        np.cumsum(np.einsum("nij,nj,nkj->nik", Ad, variance, Ad), axis=0, out=walk[1:])
        np.cumsum(Ad * length[:, None, None], axis=0, out=bias[1:])
        sigma = np.repeat([drift.rotation_bias, drift.translation_bias], 3)
        return cls(walk, bias, sigma)

    def covariance(self, T_odom_body: FloatArray, i: np.ndarray, j: np.ndarray) -> FloatArray:
        """Covariances `(M, 6, 6)` of `T_i_j`, as errors in frame j, for index arrays `i, j (M,)` in any order."""
        sign = np.where(i <= j, 1.0, -1.0)[:, None, None]
        to_j = se3.adjoint(se3.inverse(T_odom_body[j]))
        bias = (self.bias[j] - self.bias[i]) * self.bias_sigma
        in_odom = sign * (self.walk[j] - self.walk[i]) + bias @ np.swapaxes(bias, 1, 2)
        return se3.rotate_covariance(to_j, in_odom)
