"""Turning rates of odometry and gyroscope between the same instants: they tell clocks and axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.frontends.inertial.windows import MOST_GAP_S, integrated, seconds_since
from wiclosure.types import BoolArray, FloatArray, ImuLog, IntArray, Trajectory

LONGEST_STEP_S = 1.0  # between poses; what turns faster than that is not seen
MOST_OFFSET_S = 3.0  # that clocks are searched for
OFFSET_STEP_S = 0.01
TELLING_RATE = 0.05  # rad/s, root mean square, below which turning tells nothing
CORRELATED = 0.5  # rates of one body have more


@dataclass(frozen=True, eq=False)
class TurningRates:
    """Mean rates over S steps of the odometry.

    Args:
        odometry: `(S, 3)` rad/s in the body's axes.
        imu: `(S, 3)` rad/s in the IMU's axes.
        seconds: `(S,)` how long each step is.
        step: `(S,)` the pose that each step begins at.
    """

    odometry: FloatArray
    imu: FloatArray
    seconds: FloatArray
    step: IntArray

    @classmethod
    def of(cls, imu: ImuLog, odometry: Trajectory, offset_s: float = 0.0) -> TurningRates:
        """Where both have no gap; `offset_s` is added to the IMU's stamps."""
        t_odom, t_imu = seconds_since(odometry, odometry.stamps_ns), seconds_since(odometry, imu.stamps_ns) + offset_s
        seconds = np.diff(t_odom)
        turned = se3.log(se3.between(odometry.poses[:-1], odometry.poses[1:]))[:, :3] / seconds[:, None]
        covered = _covered(t_imu, t_odom) & (seconds <= LONGEST_STEP_S)
        angles = integrated(t_imu, imu.turning_rate)
        at_poses = np.stack([np.interp(t_odom, t_imu, angles[:, axis]) for axis in range(3)], axis=1)
        rates = np.diff(at_poses, axis=0) / seconds[:, None]
        return cls(turned[covered], rates[covered], seconds[covered], np.flatnonzero(covered))

    def __len__(self) -> int:
        return len(self.seconds)

    @property
    def tells(self) -> bool:
        """Whether the robot turns enough for any conclusion."""
        return len(self) > 10 and float(np.sqrt(np.mean(np.sum(self.odometry**2, axis=1)))) > TELLING_RATE

    @property
    def correlation(self) -> float:
        """Of the two rates' sizes, which no mounting changes."""
        sizes = [np.linalg.norm(rates, axis=1) for rates in (self.odometry, self.imu)]
        if len(self) < 10 or any(np.ptp(size) < 1e-9 for size in sizes):
            return 0.0
        return float(np.corrcoef(*sizes)[0, 1])

    @property
    def scale(self) -> float:
        """Size of the odometry's rates in those of the IMU: 1, or 0.0175 where these are degrees per second."""
        sizes = [np.linalg.norm(rates, axis=1) for rates in (self.odometry, self.imu)]
        return float(sizes[0] @ sizes[1] / max(float(sizes[1] @ sizes[1]), 1e-12))


def clock_offset_s(imu: ImuLog, odometry: Trajectory) -> tuple[float, float]:
    """What is missing to the IMU's stamps where rates correlate best, s, and that correlation."""
    offsets = np.arange(-MOST_OFFSET_S, MOST_OFFSET_S + OFFSET_STEP_S / 2, OFFSET_STEP_S)
    t_odom, t_imu = seconds_since(odometry, odometry.stamps_ns), seconds_since(odometry, imu.stamps_ns)
    middle, seconds = 0.5 * (t_odom[1:] + t_odom[:-1]), np.diff(t_odom)
    turned = se3.rotation_angle(se3.between(odometry.poses[:-1], odometry.poses[1:])) / seconds
    size = np.linalg.norm(imu.turning_rate, axis=1)
    swept = np.concatenate([[0.0], np.cumsum(0.5 * (size[1:] + size[:-1]) * np.diff(t_imu))])
    inside = (middle > t_imu[0] + MOST_OFFSET_S) & (middle < t_imu[-1] - MOST_OFFSET_S) & (seconds <= LONGEST_STEP_S)
    if inside.sum() < 10:
        return 0.0, 0.0
    begin, end, turned, seconds = t_odom[:-1][inside], t_odom[1:][inside], turned[inside], seconds[inside]
    found = [
        (np.interp(end - o, t_imu, swept) - np.interp(begin - o, t_imu, swept)) / seconds for o in offsets.tolist()
    ]
    sizes = np.stack(found) - np.mean(found, axis=1, keepdims=True)
    centred = turned - turned.mean()
    spread = np.linalg.norm(sizes, axis=1) * np.linalg.norm(centred)
    correlation = sizes @ centred / np.maximum(spread, 1e-12)
    best = int(np.argmax(correlation))
    return float(offsets[best]), float(correlation[best])


def _covered(t_imu: FloatArray, t_odom: FloatArray) -> BoolArray:
    """Steps `(N - 1,)` of the odometry within which the IMU has no gap."""
    gap = np.flatnonzero(np.diff(t_imu) > MOST_GAP_S)
    bounds_begin = np.concatenate([[-np.inf], t_imu[gap], [t_imu[-1]]])
    bounds_end = np.concatenate([[t_imu[0]], t_imu[gap + 1], [np.inf]])
    first = np.searchsorted(bounds_end, t_odom[:-1], side="right")  # the first gap that ends after the step begins
    return np.asarray(bounds_begin[np.minimum(first, len(bounds_begin) - 1)] >= t_odom[1:])
