"""Ranges and bearings between keyframes of two robots as factors of the pose graph.

GTSAM's own range and bearing factors join the origins of two poses.  Antennas sit elsewhere, and a measurement falls
between two keyframes: here both ends have a lever arm.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import null_space

from wiclosure import se3
from wiclosure.backends.factor_graph.factors import CAUCHY_WIDTH, Keys
from wiclosure.types import FloatArray, RadioLinks, Trajectory

_NEAREST_M = 0.1  # antennas come no closer: keeps bearings of near robots finite

_Error = Callable[[gtsam.CustomFactor, gtsam.Values, list[FloatArray] | None], FloatArray]


def radio_factors(
    radio: Sequence[RadioLinks], trajectories: Mapping[str, Trajectory], keys: Keys
) -> list[gtsam.NonlinearFactor]:
    """One factor for each range and each bearing, under a Cauchy kernel: walls lengthen ranges and bend bearings.

    And one for each two robots that holds their frames level to each other, as far as gravity tells.
    """
    kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY_WIDTH)
    factors: list[gtsam.NonlinearFactor] = []

    def add(sighting: _Sighting, noise: gtsam.noiseModel.Gaussian, error: _Error) -> None:
        robust = gtsam.noiseModel.Robust.Create(kernel, noise)
        factors.append(gtsam.CustomFactor(robust, [sighting.receiver, sighting.transmitter], error))

    for links in radio:
        factors.append(_level(links, trajectories, keys))
        for row, sighting in enumerate(_sightings(links, keys)):
            if np.isfinite(links.range_m[row]):
                of_range = gtsam.noiseModel.Isotropic.Sigma(1, links.range_sigma_m[row])
                add(sighting, of_range, _range_error(sighting, float(links.range_m[row])))
            if np.isfinite(links.direction[row]).all():
                across = null_space(links.direction[row][None]).T  # the tangent plane of the direction, (2, 3)
                of_bearing = gtsam.noiseModel.Gaussian.Covariance(across @ links.direction_covariance[row] @ across.T)
                add(sighting, of_bearing, _bearing_error(sighting, across))
    return factors


@dataclass(frozen=True, slots=True, eq=False)
class _Sighting:
    """From one antenna to another.

    Args:
        receiver, transmitter: keys of their keyframes.
        arm_receiver, arm_transmitter: `(3,)` the antennas in the body axes of these keyframes, m.
    """

    receiver: int
    transmitter: int
    arm_receiver: FloatArray
    arm_transmitter: FloatArray

    def displacement(self, values: gtsam.Values) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
        """Receiver's to transmitter's antenna `(3,)` in the receiver's body axes, and `(3, 6)` by either pose."""
        T_receiver_transmitter = values.atPose3(self.receiver).between(values.atPose3(self.transmitter)).matrix()
        R, place = T_receiver_transmitter[:3, :3], T_receiver_transmitter[:3] @ np.append(self.arm_transmitter, 1.0)
        by_receiver = np.hstack([se3.skew(place), -np.eye(3)])
        by_transmitter = R @ np.hstack([-se3.skew(self.arm_transmitter), np.eye(3)])
        return place - self.arm_receiver, (by_receiver, by_transmitter)


def _sightings(links: RadioLinks, keys: Keys) -> list[_Sighting]:
    ends_a = zip(keys.all(links.robot_a, links.index_a), links.antenna_a, strict=True)
    ends_b = zip(keys.all(links.robot_b, links.index_b), links.antenna_b, strict=True)
    return [
        _Sighting(a, b, arm_a, arm_b) if receives else _Sighting(b, a, arm_b, arm_a)
        for receives, (a, arm_a), (b, arm_b) in zip(links.a_receives, ends_a, ends_b, strict=True)
    ]


def _level(links: RadioLinks, trajectories: Mapping[str, Trajectory], keys: Keys) -> gtsam.NonlinearFactor:
    """Between the first keyframes, whose places in the odometry frames are known."""
    T_odom_first_a, T_odom_first_b = (trajectories[robot].poses[0] for robot in (links.robot_a, links.robot_b))
    covariance = se3.compose_covariance(links.level, T_odom_first_b, np.zeros((6, 6)))
    first_to_first = se3.inverse(T_odom_first_a) @ links.T_a_b @ T_odom_first_b
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    return gtsam.BetweenFactorPose3(keys(links.robot_a, 0), keys(links.robot_b, 0), gtsam.Pose3(first_to_first), noise)


def _range_error(sighting: _Sighting, range_m: float) -> _Error:
    def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        seen, derivatives = sighting.displacement(values)
        distance = max(float(np.linalg.norm(seen)), _NEAREST_M)
        if jacobians is not None:
            jacobians[0], jacobians[1] = ((seen / distance)[None] @ by for by in derivatives)
        return np.array([distance - range_m])

    return error


def _bearing_error(sighting: _Sighting, across: FloatArray) -> _Error:
    """Part of the unit vector to the transmitter that lies across the measured direction.

    It vanishes in the opposite direction too: the start has to be on the right side, as the filter's alignment is.
    """

    def error(_: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None) -> FloatArray:
        seen, derivatives = sighting.displacement(values)
        distance = max(float(np.linalg.norm(seen)), _NEAREST_M)
        unit = seen / distance
        if jacobians is not None:
            turned = across @ (np.eye(3) - np.outer(unit, unit)) / distance
            jacobians[0], jacobians[1] = (turned @ by for by in derivatives)
        return np.asarray(across @ unit)

    return error
