"""Specific force and odometry over windows of some seconds: sums in which the robot's own motion cancels.

With p the sensor's path, f its specific force and g the vector against gravity, all in the odometry frame, f = p'' + g.
Weighted by w = cos^2, which fades to zero at both ends of a window together with its first derivative,

    g = (sum of w f - sum of w p'') / sum of w.

Odometry is taken as straight between its poses, so p'' is a change of velocity at each pose: motion at a constant
velocity cancels whatever the stamps are, and nobody has to know the velocity at the ends, as preintegration does.
What depends on the mounting is linear in it, so that it is summed once (`Windows`) and solved for afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy import sparse

from wiclosure.types import BoolArray, FloatArray, ImuLog, IntArray, Trajectory

WINDOW_S = 6.0  # accelerations of a drive average out, odometry hardly drifts
HOP_S = WINDOW_S / 2  # the weights of two such windows sum to one: all samples count the same
MOST_GAP_S = 0.3  # without IMU; a twentieth of a window
MOST_GAP_ODOMETRY_S = 1.5  # without poses

_NONE = np.zeros(0, np.int64)

_Weights: TypeAlias = sparse.csr_matrix


@dataclass(frozen=True, eq=False)
class Windows:
    """Sums over W windows, in the odometry frame.

    Args:
        stamps_ns: `(W,)` their middles.
        force: `(W, 3, 3, 3)`: contracted with `R_body_imu` over the last two axes the mean specific force, m/s^2.
        acceleration: `(W, 3)` mean acceleration of the body, m/s^2.
        bias: `(W, 3, 3)`: times an accelerometer bias in the body's axes the part of it in the mean force.
        lever: `(W, 3, 3)`: times the IMU's place in the body the acceleration that turning adds there, m/s^2.
    """

    stamps_ns: IntArray
    force: FloatArray
    acceleration: FloatArray
    bias: FloatArray
    lever: FloatArray

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def subset(self, rows: BoolArray) -> Windows:
        """Some of the windows."""
        return Windows(
            self.stamps_ns[rows], self.force[rows], self.acceleration[rows], self.bias[rows], self.lever[rows]
        )

    def gravity(self, R_body_imu: FloatArray) -> FloatArray:
        """`(W, 3)` vectors against gravity, m/s^2, with bias and lever arm left in."""
        return np.asarray(np.einsum("wijk,jk->wi", self.force, R_body_imu) - self.acceleration)


def windows_along(imu: ImuLog, odometry: Trajectory, spoiled_ns: IntArray = _NONE) -> Windows:
    """All windows that both sensors cover without gaps.

    Args:
        imu: samples in the clock of the odometry.
        odometry: `T_odom_body`.
        spoiled_ns: `(K,)` stamps that no window may hold, increasing.
    """
    t_imu, t_odom = seconds_since(odometry, imu.stamps_ns), seconds_since(odometry, odometry.stamps_ns)
    centres = _centres(t_imu, t_odom, seconds_since(odometry, spoiled_ns))
    of_imu, of_odom = _weights(t_imu, centres, np.gradient(t_imu)), _weights(t_odom, centres, np.ones(len(t_odom)))
    total = np.asarray(of_imu.sum(axis=1))
    R = odometry.at(imu.stamps_ns)[:, :3, :3]
    force = (of_imu @ np.einsum("nij,nk->nijk", R, imu.acceleration).reshape(-1, 27)) / total
    return Windows(
        stamps_ns=odometry.stamps_ns[0] + np.rint(centres * 1e9).astype(np.int64),
        force=force.reshape(-1, 3, 3, 3),
        acceleration=(of_odom @ velocity_steps(odometry.positions, t_odom)) / total,
        bias=((of_imu @ R.reshape(-1, 9)) / total).reshape(-1, 3, 3),
        lever=((of_odom @ velocity_steps(odometry.poses[:, :3, :3].reshape(-1, 9), t_odom)) / total).reshape(-1, 3, 3),
    )


def seconds_since(odometry: Trajectory, stamps_ns: IntArray) -> FloatArray:
    """Seconds `(N,)` after the first pose."""
    return np.asarray((stamps_ns - odometry.stamps_ns[0]) * 1e-9)


def integrated(seconds: FloatArray, values: FloatArray) -> FloatArray:
    """`(N, D)` from the first of the samples `(N, D)` on, by the trapezoidal rule; zero there."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(seconds)[:, None]
    return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])


def velocity_steps(values: FloatArray, seconds: FloatArray) -> FloatArray:
    """`(N, D)`: by how much the slope changes at each of the values `(N, D)`; zero at both ends."""
    slopes = np.diff(values, axis=0) / np.diff(seconds)[:, None]
    steps = np.zeros_like(values)
    steps[1:-1] = np.diff(slopes, axis=0)
    return steps


def _centres(t_imu: FloatArray, t_odom: FloatArray, spoiled: FloatArray) -> FloatArray:
    """Middles of windows, s, in which neither has a gap, and nothing is spoiled."""
    if len(t_imu) < 3 or len(t_odom) < 3:
        return np.zeros(0)
    begin, end = max(t_imu[0], t_odom[0]), min(t_imu[-1], t_odom[-1])
    centres = np.arange(begin + WINDOW_S / 2, end - WINDOW_S / 2, HOP_S)
    for times, most in ((t_imu, MOST_GAP_S), (t_odom, MOST_GAP_ODOMETRY_S)):
        gap = np.flatnonzero(np.diff(times) > most)
        first = np.searchsorted(times[gap + 1], centres - WINDOW_S / 2, side="right")
        begins = np.append(times[gap], np.inf)[first]  # of the first gap that ends within the window or after
        centres = centres[begins >= centres + WINDOW_S / 2]
    low, high = (np.searchsorted(spoiled, centres + side * WINDOW_S / 2) for side in (-1, 1))
    return np.asarray(centres[low == high])


def _weights(times: FloatArray, centres: FloatArray, each: FloatArray) -> _Weights:
    """`(W, N)`: the weight of each sample in each window, times `each`."""
    low, high = (np.searchsorted(times, centres + side * WINDOW_S / 2) for side in (-1, 1))
    row = np.repeat(np.arange(len(centres)), high - low)
    column = np.arange(len(row)) - np.repeat(np.cumsum(high - low) - (high - low), high - low) + low[row]
    weight = np.cos(np.pi * (times[column] - centres[row]) / WINDOW_S) ** 2 * each[column]
    return sparse.csr_matrix((weight, (row, column)), (len(centres), len(times)))
