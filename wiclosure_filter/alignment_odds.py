"""What the radio says of a closure: every closure implies how two odometry frames lie, and that can be held against it.

Where places look alike, closures of one look-alike place agree with each other as well as true ones do.  The paper uses
the radio before scans are compared only; the same measurements also tell such sets apart afterwards, even a handful
that leave too many alignments to prune by.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, IntArray, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.alignment_settings import AlignmentSettings
from wiclosure.wiclosure_filter.link_gathering import links_between
from wiclosure.wiclosure_filter.mixture import Mixture
from wiclosure.wiclosure_filter.observations import Observations, drift_since
from wiclosure.wiclosure_filter.refinement import Prior


@dataclass(frozen=True, eq=False)
class AlignmentOdds:
    """Weighs the alignments that closures imply against the likeliest ones.

    Implements `wiclosure.types.ClosureCheck`.

    Args:
        best: states `(B, 4)` of the likeliest alignments.
        observations: all that the robots measured of each other.
        prior: what else is known of the alignment.
        trajectories: of a and b.
        settings: what is believed of the radio.
        most_odds: against a closure, beyond which it is refused.
    """

    best: FloatArray
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
        hypotheses = [alignment.best, *alignment.rivals]
        if alignment.runner_up is not None:
            hypotheses.append(alignment.runner_up)
        return cls(
            np.array([observations.state(hypothesis.T_a_b) for hypothesis in hypotheses]),
            observations,
            Prior.of(observations, settings, alignment.heading_knowledge == "heading"),
            (trajectories[alignment.robot_a], trajectories[alignment.robot_b]),
            settings,
            most_odds,
        )

    def objections(
        self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray
    ) -> tuple[str, ...]:
        """See `wiclosure.types.ClosureCheck`."""
        return tuple(
            f"contradicts the radio: what it measured is {_times(log_odds)} times likelier under another alignment"
            if log_odds > np.log(self.most_odds)
            else ""
            for log_odds in self.log_odds(T_a_b, covariance, index_a, index_b).tolist()
        )

    def log_odds(self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray) -> FloatArray:
        """Natural logarithms `(N,)` of the odds for the likeliest alignment and against those that closures imply.

        The odometry of both robots may have drifted since they were where the closure is: measurements made elsewhere
        count for less, as in the search for the alignment.  Arguments are those of `objections`.
        """
        a, b = self.trajectories
        T_frames = a.poses[index_a] @ T_a_b @ se3.inverse(b.poses[index_b])
        closures = zip(T_frames, covariance, index_a.tolist(), index_b.tolist(), strict=True)
        return np.array([self._against(*closure) for closure in closures])

    def _against(self, T_frames: FloatArray, covariance: FloatArray, index_a: int, index_b: int) -> float:
        position_m, yaw_rad = drift_since(
            index_a, index_b, self.observations, self.trajectories, self.settings.drift_inflation
        )
        own_m, own_rad = np.sqrt(covariance[3:5, 3:5].trace() / 2), np.sqrt(covariance[2, 2])
        mixture = Mixture.of(
            self.observations, self.settings.radio, (np.hypot(position_m, own_m), np.hypot(yaw_rad, own_rad))
        )
        states = np.vstack([self.observations.state(T_frames), self.best])
        score = mixture.log_likelihood(states) + self.prior.log_density(states)
        return float(score.max() - score[0])


def _times(log_odds: float) -> str:
    """Odds in words that stay short."""
    power = log_odds / np.log(10)
    return f"{np.exp(log_odds):,.0f}" if power < 6 else f"10^{power:.0f}"
