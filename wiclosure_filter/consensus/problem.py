"""What is known of two robots before their frames are aligned: measurements, odometry, noise and priors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, IntArray, Trajectory
from wiclosure.wiclosure_filter.config import AlignmentSettings, RadioModel
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.likelihood.heights import height_sigma_m
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
from wiclosure.wiclosure_filter.links.links import Links


@dataclass(frozen=True, eq=False)
class PairOdometry:
    """Two trajectories, each in its own odometry frame.

    Args:
        a, b: the trajectories.
        inflation: factor on their standard deviations, since drift models are optimistic.
        scale: standard deviation of each one's scale.
    """

    a: Trajectory
    b: Trajectory
    inflation: float
    scale: float = 0.0

    def drift_from(self, anchor: int, observations: Observations) -> tuple[FloatArray, FloatArray]:
        """How far a rigid transform that is right at one measurement may be off at the others, see `drift_since`."""
        return self.drift_since(int(observations.index_a[anchor]), int(observations.index_b[anchor]), observations)

    def drift_since(
        self, at_a: int | IntArray, at_b: int | IntArray, observations: Observations
    ) -> tuple[FloatArray, FloatArray]:
        """How far a rigid transform that is right where a and b are at some keyframes may be off at the measurements.

        Args:
            at_a: keyframe of a, or `(M,)` one for each measurement.
            at_b: of b.
            observations: M measurements.

        Returns:
            Standard deviations `(M,)` of the horizontal position (m) and of the yaw (rad) of the robots relative to
            each other, by the drift of both since then, and by their scales.
        """
        position_variance, yaw_variance = np.zeros(len(observations)), np.zeros(len(observations))
        for trajectory, at, index in ((self.a, at_a, observations.index_a), (self.b, at_b, observations.index_b)):
            covariance = trajectory.relative_covariance(np.broadcast_to(at, len(index)), index)
            moved = np.linalg.norm((trajectory.positions[index] - trajectory.positions[at])[:, :2], axis=1)
            position_variance += self.inflation**2 * (covariance[:, 3, 3] + covariance[:, 4, 4]) / 2
            position_variance += (self.scale * moved) ** 2
            yaw_variance += self.inflation**2 * covariance[:, 2, 2]
        return np.sqrt(position_variance), np.sqrt(yaw_variance)

    def covariance_a(self, i: IntArray, j: IntArray) -> FloatArray:
        """`(M, 6, 6)` of a's motion between keyframes, inflated; see `Trajectory.relative_covariance`."""
        return self.inflation**2 * self.a.relative_covariance(i, j)

    def covariance_b(self, i: IntArray, j: IntArray) -> FloatArray:
        """The same of b."""
        return self.inflation**2 * self.b.relative_covariance(i, j)


@dataclass(frozen=True, eq=False)
class AlignmentProblem:
    """Two robots whose frames are to be aligned.

    Args:
        observations: M measurements.
        odometry: of both.
        radio: what is assumed of the radio.
        prior: on yaw and height.
        heading_knowledge: `heading`, `reciprocal`, `one-way` or `range-only`: what tells the relative yaw.
        partner: `(M,)` the measurement in the opposite direction at about the same time, or -1.
    """

    observations: Observations
    odometry: PairOdometry
    radio: RadioModel
    prior: Prior
    heading_knowledge: str
    partner: IntArray

    @classmethod
    def of(cls, links: Links, trajectories: Mapping[str, Trajectory], settings: AlignmentSettings) -> AlignmentProblem:
        """From links, of which there must be one at least."""
        observations = Observations.of(links, settings.radio)
        partner = reciprocal_partners(links, settings.reciprocal_tolerance_s)
        knowledge = settings.heading if settings.heading != "auto" else heading_knowledge(links, partner)
        a, b = trajectories[links.robot_a], trajectories[links.robot_b]
        sigma_m = settings.height_sigma_m
        if settings.gravity_aligned and not observations.tells_height:
            sigma_m = height_sigma_m(a, b, observations.typical_distance_m, settings)
        prior = Prior.of(observations, use_headings=knowledge == "heading", height_sigma_m=sigma_m)
        odometry = PairOdometry(a, b, settings.drift_inflation, settings.calibration.scale)
        return cls(observations, odometry, settings.radio, prior, knowledge, partner)

    def anchored_at(self, anchor: int) -> tuple[Mixture, tuple[FloatArray, FloatArray]]:
        """Likelihood of a transform that holds at one of the measurements, and the drift from there to the others."""
        drift = self.odometry.drift_from(anchor, self.observations)
        return Mixture.of(self.observations, self.radio, drift), drift


def heading_knowledge(links: Links, partner: IntArray) -> str:
    """What tells the relative yaw: the strongest source that the links hold."""
    if np.isfinite(links.yaw).any():
        return "heading"
    if (partner >= 0).any():
        return "reciprocal"
    return "one-way" if links.has_bearing.any() else "range-only"


def reciprocal_partners(links: Links, tolerance_s: float) -> IntArray:
    """`(M,)` for each bearing, the opposite bearing nearest in time; -1 where there is none within tolerance."""
    partner = np.full(len(links), -1)
    here, there = (np.flatnonzero(links.has_bearing & (links.a_receives == direction)) for direction in (True, False))
    if len(here) == 0 or len(there) == 0:
        return partner
    apart = np.abs(links.stamp_a_ns[here][:, None] - links.stamp_a_ns[there][None, :])
    for rows, others, gap in ((here, there, apart), (there, here, apart.T)):
        nearest = np.argmin(gap, axis=1)
        close = gap[np.arange(len(rows)), nearest] <= tolerance_s * 1e9
        partner[rows[close]] = others[nearest[close]]
    return partner
