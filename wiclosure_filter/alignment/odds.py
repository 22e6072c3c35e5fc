"""What the radio says of a closure: every closure implies how two odometry frames lie, and that can be held against it.

Where places look alike, closures of one look-alike place agree with each other as well as true ones do.  The paper uses
the radio before scans are compared only; the same measurements also tell such sets apart afterwards, even a handful
that leave too many alignments to prune by.  Where the links of two robots serve to predict, the prediction says it
better: those of other robots stand behind it too, and they have corrected the odometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, IntArray, Trajectory, WirelessLog, capped_covariance
from wiclosure.wiclosure_filter.alignment.mixture import Mixture
from wiclosure.wiclosure_filter.alignment.observations import Observations, drift_from, drift_since
from wiclosure.wiclosure_filter.alignment.refinement import Prior, climb
from wiclosure.wiclosure_filter.alignment.settings import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import links_between


@dataclass(frozen=True, eq=False)
class AlignmentOdds:
    """Weighs the alignments that closures imply against all others.

    Implements `wiclosure.types.ClosureCheck`.

    Args:
        likely: states `(B, 4)` of the alignments that the search found.
        observations: all that the robots measured of each other.
        prior: what else is known of the alignment; of heights next to nothing.
        trajectories: of a and b.
        settings: what is believed of the radio.
        most_odds: against a closure, beyond which it is refused.
    """

    likely: FloatArray
    observations: Observations
    prior: Prior
    trajectories: tuple[Trajectory, Trajectory]
    settings: AlignmentSettings
    most_odds: float

    @classmethod
    def of(
        cls,
        alignment: FrameAlignment,
        trajectories: Mapping[str, Trajectory],
        wireless: WirelessLog,
        settings: AlignmentSettings,
        most_odds: float,
    ) -> AlignmentOdds | None:
        """For two robots; None where nothing is aligned, or where frames may be tilted, which a state does not tell."""
        if alignment.best is None or not settings.gravity_aligned:
            return None
        links = links_between(alignment.robot_a, alignment.robot_b, trajectories, wireless, settings)
        observations = Observations.of(links.thinned(settings.max_measurements), settings)
        others = alignment.rivals or (() if alignment.runner_up is None else (alignment.runner_up,))
        prior = Prior.of(observations, settings, alignment.heading_knowledge == "heading")
        return cls(
            np.array([observations.state(hypothesis.T_a_b) for hypothesis in (alignment.best, *others)]),
            observations,
            # That robots are about level with each other helps a search; it is nothing to hold against a measured pose.
            replace(prior, height_sigma_m=settings.height_sigma_m),
            (trajectories[alignment.robot_a], trajectories[alignment.robot_b]),
            settings,
            most_odds,
        )

    def objections(
        self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray
    ) -> tuple[str, ...]:
        """See `wiclosure.types.ClosureCheck`."""
        return tuple(
            f"contradicts the radio: 10^{log_odds / np.log(10):.0f} to 1 that the robots' frames lie otherwise"
            if log_odds > np.log(self.most_odds)
            else ""
            for log_odds in self.log_odds(T_a_b, covariance, index_a, index_b).tolist()
        )

    def log_odds(self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray) -> FloatArray:
        """Natural logarithms `(N,)` of the odds for the likeliest alignment, against the one that each closure implies.

        A closure leaves the alignment at the measurements open by its covariance, and by the drift of odometry between:
        it is judged by the likeliest one that it allows.  Arguments are those of `objections`.
        """
        a, b = self.trajectories
        states = np.array(
            [self.observations.state(T) for T in a.poses[index_a] @ T_a_b @ se3.inverse(b.poses[index_b])]
        )
        drift = [
            drift_since(i, j, self.observations, self.trajectories, self.settings.drift_inflation)
            for i, j in zip(index_a.tolist(), index_b.tolist(), strict=True)
        ]
        anchors = np.array([np.argmin(position_m) for position_m, _ in drift], np.int64)
        odds = np.zeros(len(states))
        for anchor in np.unique(anchors).tolist():  # closures of one place share the measurement nearest to them
            rows = np.flatnonzero(anchors == anchor)
            mixture, prior = self._around(anchor)
            best = self._highest(states[rows], mixture, prior)
            for row in rows:
                position_m, yaw_rad = (float(of_each[anchor]) for of_each in drift[row])
                lever_m = self._lever_m(anchor, int(index_b[row]))
                spread = self._spread(anchor, states[row, 0], covariance[row], lever_m, position_m, yaw_rad)
                allowed = _Near(**vars(prior), centre=states[row], information=np.asarray(np.linalg.inv(spread), float))
                odds[row] = best - self._highest(states[[row]], mixture, allowed)
        return np.maximum(odds, 0.0)

    def _highest(self, states: FloatArray, mixture: Mixture, prior: Prior) -> float:
        """The highest peak of the posterior that is reached from some states or from the likely ones."""
        starts = np.vstack([states, self.likely])
        return float(climb(starts, mixture, prior, finalists=len(starts)).log_posterior.max())

    def _around(self, anchor: int) -> tuple[Mixture, Prior]:
        """Likelihood and prior of an alignment that holds at one of the measurements.

        Elsewhere the odometry has drifted, and by much the same at all measurements there: by as much as drift exceeds
        their noise, each counts for less, or they would outvote the truth together.
        """
        observations = self.observations
        position_m, yaw_rad = drift_from(anchor, observations, self.trajectories, self.settings.drift_inflation)
        counted = observations.independence / (1.0 + (position_m / self._noise_m) ** 2)
        mixture = Mixture.of(replace(observations, independence=counted), self.settings.radio, (position_m, yaw_rad))
        known = np.isfinite(observations.yaw)
        since_compass = float(np.median(yaw_rad[known])) if known.any() else 0.0
        return mixture, replace(self.prior, yaw_sigma=float(np.hypot(self.prior.yaw_sigma, since_compass)))

    @property
    def _noise_m(self) -> FloatArray:
        """`(M,)` m, how exact each measurement is: its range, or its most exact path across the distance."""
        observations = self.observations
        distance = np.where(np.isfinite(observations.near_range_m), observations.near_range_m, 30.0)
        across = np.where(observations.weight > 0, observations.sigma, np.inf).min(axis=1) * distance
        along = np.where(np.isfinite(observations.range_m), observations.range_sigma_m, np.inf)
        return np.asarray(np.minimum(along, across))

    def _lever_m(self, anchor: int, index_b: int) -> float:
        """From a keyframe of b to where b was when the anchor was measured."""
        at_anchor = self.observations.b[anchor] + self.observations.centre_b
        return float(np.linalg.norm(at_anchor - self.trajectories[1].positions[index_b]))

    def _spread(
        self, anchor: int, yaw_rad: float, covariance: FloatArray, lever_m: float, drift_m: float, drift_rad: float
    ) -> FloatArray:
        """Covariance `(4, 4)` of the state that a closure of covariance `(6, 6)` implies at the anchor."""
        rotation, translation = np.split(np.diag(capped_covariance(covariance)), 2)
        yaw = rotation[2] + drift_rad**2
        spread = np.diag([yaw, *np.full(3, translation.max() + rotation.max() * lever_m**2 + drift_m**2)])
        # A state's place is that of the centre of b's antennas: a yaw error about the anchor moves it sideways.
        x, y, _ = -self.observations.b[anchor]
        across = np.array([-np.sin(yaw_rad) * x - np.cos(yaw_rad) * y, np.cos(yaw_rad) * x - np.sin(yaw_rad) * y])
        spread[0, 1:3] = spread[1:3, 0] = yaw * across
        spread[1:3, 1:3] += yaw * np.outer(across, across)
        return spread


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
        off[:, 0] = (off[:, 0] + np.pi) % (2 * np.pi) - np.pi
        return off
