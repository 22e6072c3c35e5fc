"""Blunders of the radio under which another alignment fits as well as the best one."""

from __future__ import annotations

from dataclasses import dataclass

from wiclosure.types import AlignmentHypothesis
from wiclosure.wiclosure_filter.alignment.followed import Followed
from wiclosure.wiclosure_filter.alignment.indistinguishable import Blunders
from wiclosure.wiclosure_filter.config import AmbiguitySettings
from wiclosure.wiclosure_filter.consensus.consensus import AnchoredPeaks
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.links.links import Links


@dataclass(frozen=True, eq=False)
class FittingBlunders:
    """Blunders that would fit as well as the best alignment: a sentence, or empty, and the alignment under each.

    Of none where it may all be a reflection, which tells no place; `log_image` is how much likelier that makes it.
    """

    sentence: str
    hypotheses: tuple[AlignmentHypothesis, ...]
    log_image: float

    @classmethod
    def of(
        cls, best: Followed, found: AnchoredPeaks, links: Links, odometry: PairOdometry, guard: AmbiguitySettings
    ) -> FittingBlunders | None:
        """None where the best alignment was not followed, or has no bearings."""
        frames, observations = best.frames, found.mixture.observations
        if frames is None or not observations.has_bearing.any():
            return None
        told = best.mixture, best.explanation, found.drift[0], found.prior
        blunders = Blunders.of(frames.w, frames.yaw, links, odometry, *told)
        likely = blunders.likely(guard.same_place_fraction * observations.typical_distance_m, guard.min_odds)
        objection = blunders.objection(likely, guard.min_odds)
        if not objection or blunders.image_odds * guard.min_odds >= 1.0:
            return cls(objection, (), blunders.log_image)
        hypotheses = tuple(blunders.hypothesis(rows[0], best.hypothesis) for rows in likely)
        return cls(objection, hypotheses, blunders.log_image)
