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
from wiclosure.arrays import FloatArray, IntArray
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

    def scaled(self, factor: float) -> DriftModel:
        """All standard deviations times `factor` > 0."""
        return DriftModel(**{name: value * factor for name, value in self.model_dump().items()})


@dataclass(frozen=True, eq=False)
class AccumulatedDrift:
    """Prefix sums of a drift model along one trajectory of N poses, in its odometry frame.

    The variances r (rotation) and t (translation) of a step are the same on all axes, so that with p the position
    after the step `Ad Q Ad^T = [[r I, r [p]x^T], [r [p]x, r [p]x [p]x^T + t I]]`: eleven numbers a pose hold its sum.

    Args:
        walk: `(N, 11)`, sums of r, r p (3), r p p^T (upper triangle, 6) and t over the steps up to each pose.
        bias: `(N, 6, 6)`, sums of `Ad(T_k) ds_k`; None where the model has no bias.
        bias_sigma: `(6,)`, standard deviations of the constant error per metre.
    """

    walk: FloatArray
    bias: FloatArray | None
    bias_sigma: FloatArray

    @classmethod
    def along(cls, T_odom_body: FloatArray, drift: DriftModel) -> AccumulatedDrift:
        """Accumulates `drift` over the poses `(N, 4, 4)` of one trajectory."""
        step = se3.between(T_odom_body[:-1], T_odom_body[1:])
        length = np.linalg.norm(step[:, :3, 3], axis=1)
        rotation = drift.rotation_walk**2 * length + drift.rotation_walk_turning**2 * se3.rotation_angle(step)
        p = T_odom_body[1:, :3, 3]
        walk = np.zeros((len(T_odom_body), 11))
        walk[1:, 0] = rotation
        walk[1:, 1:4] = rotation[:, None] * p
        walk[1:, 4:10] = rotation[:, None] * p[:, _UPPER[0]] * p[:, _UPPER[1]]
        walk[1:, 10] = drift.translation_walk**2 * length
        np.cumsum(walk, axis=0, out=walk)
        sigma = np.repeat([drift.rotation_bias, drift.translation_bias], 3)
        if not sigma.any():
            return cls(walk, None, sigma)
        bias = np.zeros((len(T_odom_body), 6, 6))
        np.cumsum(se3.adjoint(T_odom_body[1:]) * length[:, None, None], axis=0, out=bias[1:])
        return cls(walk, bias, sigma)

    def between(self, i: np.ndarray, j: np.ndarray) -> FloatArray:
        """Covariances `(M, 6, 6)` of `T_i_j`, as errors in the odometry frame, for index arrays in any order."""
        covariance = _walk_covariance(np.where(i <= j, 1.0, -1.0)[:, None] * (self.walk[j] - self.walk[i]))
        if self.bias is not None:
            bias = (self.bias[j] - self.bias[i]) * self.bias_sigma
            covariance += bias @ np.swapaxes(bias, 1, 2)
        return covariance

    def rotation_variance(self, i: np.ndarray, j: np.ndarray) -> FloatArray:
        """Variances `(M,)` of the rotation of `T_i_j`, summed over the axes."""
        variance = 3.0 * np.abs(self.walk[j, 0] - self.walk[i, 0])
        if self.bias is not None:
            variance += np.sum(((self.bias[j, :3] - self.bias[i, :3]) * self.bias_sigma) ** 2, axis=(1, 2))
        return np.asarray(variance)

    def translation_variance(self, T_odom_body: FloatArray, i: np.ndarray, j: np.ndarray) -> FloatArray:
        """Variances `(M,)` of the translation of `T_i_j`, summed over the axes."""
        if self.bias is not None:
            return np.asarray(self.covariance(T_odom_body, i, j)[:, 3:, 3:].trace(axis1=1, axis2=2))
        sums, position = np.where(i <= j, 1.0, -1.0)[:, None] * (self.walk[j] - self.walk[i]), T_odom_body[j, :3, 3]
        squares = sums[:, 4] + sums[:, 7] + sums[:, 9]  # xx, yy and zz of the upper triangle
        across = np.einsum("mk,mk->m", position, sums[:, 0, None] * position - 2.0 * sums[:, 1:4])
        return np.asarray(np.maximum(2.0 * (squares + across), 0.0) + 3.0 * sums[:, 10])

    def covariance(self, T_odom_body: FloatArray, i: np.ndarray, j: np.ndarray) -> FloatArray:
        """Covariances `(M, 6, 6)` of `T_i_j`, as errors in frame j."""
        return se3.rotate_covariance(se3.adjoint(se3.inverse(T_odom_body[j])), self.between(i, j))


@dataclass(frozen=True, eq=False)
class AccumulatedSteps:
    """Sums of stated covariances, for odometry that brings its own (a g2o file, another program).

    Args:
        sums: `(N, 6, 6)`, covariances of the steps from the first pose to each, in the odometry frame.
        ancestors: where odometry branches, `(K, N)`: the pose 2^k steps before each. None: a chain.
        depth: `(N,)`, the number of steps from the first pose to each; None for a chain.
    """

    sums: FloatArray
    ancestors: IntArray | None = None
    depth: IntArray | None = None

    @classmethod
    def along(cls, T_odom_body: FloatArray, steps: FloatArray, parents: IntArray | None = None) -> AccumulatedSteps:
        """Accumulates the covariances `(N - 1, 6, 6)` of the steps to all poses `(N, 4, 4)` but the first.

        Args:
            T_odom_body: poses.
            steps: covariances.
            parents: `(N,)` the pose that each step starts from; None: the one before.
        """
        sums = np.zeros((len(T_odom_body), 6, 6))
        sums[1:] = se3.rotate_covariance(se3.adjoint(T_odom_body[1:]), steps)
        if parents is None:
            np.cumsum(sums, axis=0, out=sums)
            return cls(sums)
        depth = (np.arange(len(sums)) > 0).astype(np.int64)
        ancestors = [parents]
        for _ in range(len(sums).bit_length()):  # pointer jumping: each round reaches twice as far back
            sums, depth = sums + sums[ancestors[-1]], depth + depth[ancestors[-1]]
            ancestors.append(ancestors[-1][ancestors[-1]])
        return cls(sums, np.stack(ancestors), depth)

    def between(self, i: np.ndarray, j: np.ndarray) -> FloatArray:
        """Covariances `(M, 6, 6)` of `T_i_j`, as errors in the odometry frame, for index arrays in any order."""
        return np.asarray(self.sums[i] + self.sums[j] - 2 * self.sums[self._fork(i, j)])

    def rotation_variance(self, i: np.ndarray, j: np.ndarray) -> FloatArray:
        """Traces `(M,)` of the rotation block of the same covariances."""
        trace = np.trace(self.sums[:, :3, :3], axis1=1, axis2=2)
        return np.asarray(trace[i] + trace[j] - 2 * trace[self._fork(i, j)])

    def translation_variance(self, T_odom_body: FloatArray, i: np.ndarray, j: np.ndarray) -> FloatArray:
        """Variances `(M,)` of the translation of `T_i_j`, summed over the axes."""
        C, lever = self.between(i, j), se3.skew(T_odom_body[j, :3, 3])
        turned = lever @ C[:, :3, :3] @ np.swapaxes(lever, 1, 2) - 2.0 * lever @ C[:, :3, 3:]
        return np.asarray(np.trace(C[:, 3:, 3:] + turned, axis1=1, axis2=2))

    def _fork(self, i: np.ndarray, j: np.ndarray) -> IntArray:
        """The last pose `(M,)` that the ways from the first pose to i and to j share."""
        if self.ancestors is None or self.depth is None:
            return np.asarray(np.minimum(i, j), np.int64)
        swap = self.depth[i] < self.depth[j]
        i, j = np.where(swap, j, i), np.where(swap, i, j)
        ahead = self.depth[i] - self.depth[j]
        for bit, before in enumerate(self.ancestors):
            i = np.where(ahead >> bit & 1, before[i], i)
        for before in self.ancestors[::-1]:
            apart = before[i] != before[j]
            i, j = np.where(apart, before[i], i), np.where(apart, before[j], j)
        return np.asarray(np.where(i == j, i, self.ancestors[0][i]), np.int64)


_UPPER = np.triu_indices(3)
_IDENTITY = np.eye(3)


def _walk_covariance(walk: FloatArray) -> FloatArray:
    """Covariances `(M, 6, 6)` of differences `(M, 11)` of prefix sums."""
    second_moment = np.empty((len(walk), 3, 3))
    second_moment[:, _UPPER[0], _UPPER[1]] = second_moment[:, _UPPER[1], _UPPER[0]] = walk[:, 4:10]
    along = np.trace(second_moment, axis1=1, axis2=2) + walk[:, 10]
    covariance = np.empty((len(walk), 6, 6))
    covariance[:, :3, :3] = walk[:, 0, None, None] * _IDENTITY
    covariance[:, 3:, :3] = se3.skew(walk[:, 1:4])
    covariance[:, :3, 3:] = np.swapaxes(covariance[:, 3:, :3], 1, 2)
    covariance[:, 3:, 3:] = along[:, None, None] * _IDENTITY - second_moment
    return covariance
