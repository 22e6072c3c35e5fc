"""Radio consistency check: every closure implies how two odometry frames lie, and that can be held against the links.

Where places look alike, closures of one look-alike place agree with each other as well as true ones do.  The paper uses
the radio before scans are compared only; the same measurements also tell such sets apart afterwards, even a handful
that leave too many alignments to prune by.  Where the links of two robots serve to predict, the prediction tells more:
those of other robots stand behind it too, and they have corrected the odometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, IntArray, Trajectory, capped_covariance
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem
from wiclosure.wiclosure_filter.consensus.refinement import Prior, climb
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Mixture
from wiclosure.wiclosure_filter.links.links import Links


@dataclass(frozen=True, eq=False)
class RadioConsistencyCheck:
    """Weighs the alignments that closures imply against all others.

    Implements `wiclosure.types.ClosureCheck`.

    Args:
        likely: states `(B, 4)` of the alignments that the search found.
        problem: all that the robots measured of each other, their odometry, and the prior; of heights next to nothing.
        max_odds: against a closure, beyond which it is rejected.
    """

    likely: FloatArray
    problem: AlignmentProblem
    max_odds: float

    @classmethod
    def of(
        cls,
        alignment: FrameAlignment,
        links: Links,
        trajectories: Mapping[str, Trajectory],
        settings: AlignmentSettings,
        max_odds: float,
    ) -> RadioConsistencyCheck | None:
        """For two robots; None where nothing is aligned, or where frames may be tilted, which a state does not tell."""
        if alignment.best is None or not settings.gravity_aligned:
            return None
        problem = AlignmentProblem.of(links.thinned(settings.max_measurements), trajectories, settings)
        others = alignment.likely_alternatives or (
            () if alignment.best_alternative is None else (alignment.best_alternative,)
        )
        states = [problem.observations.state(hypothesis.T_a_b) for hypothesis in (alignment.best, *others)]
        # That robots are about level with each other helps a search; it is nothing to hold against a measured pose.
        prior = replace(problem.prior, height_sigma_m=settings.height_sigma_m)
        return cls(np.array(states), replace(problem, prior=prior), max_odds)

    def objections(
        self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray
    ) -> tuple[str, ...]:
        """See `wiclosure.types.ClosureCheck`."""
        return tuple(
            f"contradicts the radio: 10^{log_odds / np.log(10):.0f} to 1 that the robots' frames lie otherwise"
            if log_odds > np.log(self.max_odds)
            else ""
            for log_odds in self.log_odds(T_a_b, covariance, index_a, index_b).tolist()
        )

    def log_odds(self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray) -> FloatArray:
        """Natural logarithms `(N,)` of the odds for the likeliest alignment, against the one that each closure implies.

        Arguments are those of `objections`.
        """
        likeliest, implied = self.log_posteriors(T_a_b, covariance, index_a, index_b)
        return np.maximum(likeliest - implied, 0.0)

    def log_posteriors(
        self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Log-posteriors `(N,)` of the likeliest alignment and of the one that each closure implies.

        Where the search found none, nothing is likelier than minus infinity.
        A closure leaves the alignment at the measurements open by its covariance, and by the drift of odometry between:
        it is weighed by the likeliest one that it allows.  0 is measurements that say nothing.  Arguments are those of
        `objections`.
        """
        observations, odometry = self.problem.observations, self.problem.odometry
        frames = odometry.a.poses[index_a] @ T_a_b @ se3.inverse(odometry.b.poses[index_b])
        states = np.array([observations.state(T) for T in frames])
        drift = [
            odometry.drift_since(i, j, observations) for i, j in zip(index_a.tolist(), index_b.tolist(), strict=True)
        ]
        anchors = np.array([np.argmin(position_m) for position_m, _ in drift], np.int64)
        likeliest, implied = np.full(len(states), -np.inf), np.zeros(len(states))
        for anchor in np.unique(anchors).tolist():  # closures of one place share the measurement nearest to them
            rows = np.flatnonzero(anchors == anchor)
            mixture, prior = self._around(anchor)
            if len(self.likely):
                likeliest[rows] = self._highest(states[rows], mixture, prior)
            for row in rows:
                drift_m, drift_rad = (float(of_each[anchor]) for of_each in drift[row])
                at_anchor = _at_anchor(covariance[row], self._lever_m(anchor, int(index_b[row])), drift_m, drift_rad)
                spread = self._spread(anchor, states[row, 0], at_anchor)
                allowed = _Near(**vars(prior), centre=states[row], information=np.asarray(np.linalg.inv(spread), float))
                implied[row] = self._highest(states[[row]], mixture, allowed)
        return likeliest, implied

    def _highest(self, states: FloatArray, mixture: Mixture, prior: Prior) -> float:
        """The highest peak of the posterior that is reached from some states or from the likely ones."""
        starts = np.vstack([states, self.likely])
        return float(climb(starts, mixture, prior, finalists=len(starts)).log_posterior.max())

    def _around(self, anchor: int) -> tuple[Mixture, Prior]:
        """Likelihood and prior of an alignment that holds at one of the measurements.

        Elsewhere the odometry has drifted, and by much the same at all measurements there: by as much as drift exceeds
        their noise, each counts for less, or they would outvote the truth together.
        """
        observations = self.problem.observations
        position_m, yaw_rad = drift = self.problem.odometry.drift_from(anchor, observations)
        counted = observations.independence / (1.0 + (position_m / self._noise_m) ** 2)
        mixture = Mixture.of(replace(observations, independence=counted), self.problem.radio, drift)
        known = np.isfinite(observations.yaw)
        since_compass = float(np.median(yaw_rad[known])) if known.any() else 0.0
        prior = self.problem.prior
        return mixture, replace(prior, yaw_sigma=float(np.hypot(prior.yaw_sigma, since_compass)))

    @property
    def _noise_m(self) -> FloatArray:
        """`(M,)` m, how exact each measurement is: its range, or its most exact path across the distance."""
        observations = self.problem.observations
        across = np.where(observations.weight > 0, observations.sigma, np.inf).min(axis=1)
        across = across * np.maximum(observations.distance_m, MIN_DISTANCE_M)
        along = np.where(np.isfinite(observations.range_m), observations.range_sigma_m, np.inf)
        return np.asarray(np.minimum(along, across))

    def _lever_m(self, anchor: int, index_b: int) -> float:
        """From a keyframe of b to where b was when the anchor was measured."""
        observations = self.problem.observations
        at_anchor = observations.b[anchor] + observations.centre_b
        return float(np.linalg.norm(at_anchor - self.problem.odometry.b.positions[index_b]))

    def _spread(self, anchor: int, yaw_rad: float, at_anchor: FloatArray) -> FloatArray:
        """Covariance `(4, 4)` of the state that a closure implies, from that of yaw and of b's place at the anchor."""
        spread = at_anchor.copy()
        # A state's place is that of the centre of b's antennas: a yaw error about the anchor moves it sideways.
        x, y, _ = -self.problem.observations.b[anchor]
        across = np.array([-np.sin(yaw_rad) * x - np.cos(yaw_rad) * y, np.cos(yaw_rad) * x - np.sin(yaw_rad) * y])
        yaw = spread[0, 0]
        spread[0, 1:3] = spread[1:3, 0] = yaw * across
        spread[1:3, 1:3] += yaw * np.outer(across, across)
        return spread


def _at_anchor(covariance: FloatArray, lever_m: float, drift_m: float, drift_rad: float) -> FloatArray:
    """Covariance `(4, 4)` of yaw and place of b at the anchor, by a closure's `(6, 6)`, its lever and the drift."""
    rotation, translation = np.split(np.diag(capped_covariance(covariance)), 2)
    place = translation.max() + rotation.max() * lever_m**2 + drift_m**2
    return np.diag([rotation[2] + drift_rad**2, place, place, place])


@dataclass(frozen=True, eq=False)
class _Near(Prior):
    """A prior with what a closure implies: a Gaussian over states around `centre (4,)`, `information (4, 4)`."""

    centre: FloatArray
    information: FloatArray

    def log_density(self, states: FloatArray) -> FloatArray:
        """See `Prior`."""
        off = self._off(states)
        return np.asarray(super().log_density(states) - np.einsum("ni,ij,nj->n", off, self.information, off) / 2)

    def add_to(self, states: FloatArray, information: FloatArray, gradient: FloatArray) -> None:
        """See `Prior`."""
        super().add_to(states, information, gradient)
        information += self.information
        gradient -= self._off(states) @ self.information

    def _off(self, states: FloatArray) -> FloatArray:
        off = states - self.centre
        off[:, 0] = se3.wrap_angle(off[:, 0])
        return off
