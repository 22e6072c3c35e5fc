"""Compass and AHRS readings as the yaw of each odometry frame in the common world axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, Heading, IntArray, Trajectory, WirelessLog


@dataclass(frozen=True, eq=False)
class OdometryHeading:
    """The headings of one robot as the yaw of its odometry frame.

    Args:
        stamps_ns: `(N,)` increasing.
        yaw_world_odom: `(N,)` rad, heading minus odometry yaw of the body.
        sigma: `(N,)` rad.
    """

    stamps_ns: IntArray
    yaw_world_odom: FloatArray
    sigma: FloatArray

    def at(self, stamps_ns: IntArray, tolerance_s: float) -> tuple[FloatArray, FloatArray]:
        """Yaw and its sigma `(M,)` at the stamps: weighted mean of the readings within the tolerance, NaN without any.

        Averaging does not lower sigma: a compass is wrong in the same way from one reading to the next.
        """
        tolerance_ns = round(tolerance_s * 1e9)
        first = np.searchsorted(self.stamps_ns, stamps_ns - tolerance_ns, side="left")
        end = np.searchsorted(self.stamps_ns, stamps_ns + tolerance_ns, side="right")
        weight = self.sigma**-2
        phasor = _window_sum(weight * np.exp(1j * self.yaw_world_odom), first, end)
        count, total = (end - first).astype(float), _window_sum(weight, first, end).real
        with np.errstate(divide="ignore", invalid="ignore"):
            sigma = np.sqrt(count / total)
        return np.where(count > 0, np.angle(phasor), np.nan), np.where(count > 0, sigma, np.nan)


def odometry_headings(trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> dict[str, OdometryHeading]:
    """Headings of each robot that has any, as far as readings lie within its trajectory's time."""
    found: dict[str, OdometryHeading] = {}
    by_robot: dict[str, list[Heading]] = {robot: [] for robot in trajectories}
    for heading in wireless.headings:
        by_robot.get(heading.robot, []).append(heading)
    for robot, trajectory in trajectories.items():
        readings = by_robot[robot]
        stamps_ns = np.array([h.stamp_ns for h in readings], np.int64)
        inside = trajectory.covers(stamps_ns)
        if inside.any():
            order = np.flatnonzero(inside)[np.argsort(stamps_ns[inside], kind="stable")]
            headings = np.array([h.heading for h in readings])[order]
            sigma = np.array([h.sigma for h in readings])[order]
            yaw_odom_body = se3.yaw(trajectory.at(stamps_ns[order]))
            found[robot] = OdometryHeading(stamps_ns[order], headings - yaw_odom_body, sigma)
    return found


def _window_sum(values: np.ndarray, first: IntArray, end: IntArray) -> np.ndarray:
    """Sums of `values[first:end]`."""
    total = np.concatenate([[0.0], np.cumsum(values.astype(complex))])
    return np.asarray(total[end] - total[first])
