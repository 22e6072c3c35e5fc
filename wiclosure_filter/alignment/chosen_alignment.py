"""The alignment that is reported, those that are as likely, and what forbids to call it certain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure.types import AlignmentHypothesis, FrameAlignment
from wiclosure.wiclosure_filter.alignment.ambiguity import Selection, support
from wiclosure.wiclosure_filter.alignment.fitting_blunders import FittingBlunders
from wiclosure.wiclosure_filter.alignment.followed import Followed
from wiclosure.wiclosure_filter.alignment.second_alignment import SecondAlignment
from wiclosure.wiclosure_filter.config import AlignmentSettings, AmbiguitySettings
from wiclosure.wiclosure_filter.likelihood.fit import Fit
from wiclosure.wiclosure_filter.links.links import Links


@dataclass(frozen=True, eq=False)
class ChosenAlignment:
    """Best alignment, different ones, and how well it fits.

    Args:
        best: as it is reported.
        others: different ones, the best first.
        fit: how well it explains the measurements.
        objections: what forbids to call it certain, the gravest first.
        fault: a systematic error that the measurements speak of, or an empty string.
        support: what carries it.
        likely: whether the different ones are the only others that are likely.
        bent_ns: when odometry slips, if it does.
        log_image: see `FrameAlignment`.
    """

    best: Followed
    others: tuple[AlignmentHypothesis, ...]
    fit: Fit
    objections: tuple[str, ...]
    fault: str
    support: str
    likely: bool
    bent_ns: tuple[int, int] | None
    log_image: float

    @classmethod
    def of(
        cls,
        selection: Selection,
        followed: Sequence[Followed],
        second: SecondAlignment | None,
        settings: AlignmentSettings,
        blunders: FittingBlunders | None = None,
    ) -> ChosenAlignment:
        """From the selection among the peaks, those that are reported, and the blunders that would fit as well."""
        best, *others = followed
        fit = best.fit
        least = settings.guard.min_fit_probability
        misfit = fit.misfit(least) or best.overstrained(least)
        sentence = "" if second is None else second.sentence
        slip = sentence if second is not None and second.slip else best.slip(settings.guard.min_odds)
        rivals = () if selection.ambiguous or second else _rivals(best, others, settings.guard)
        contested = _contested(best, rivals[0]) if rivals else ""
        if second is None:
            others = [*(rivals or others[: len(selection.others)])]
        ambiguous = selection.reason if selection.ambiguous else best.vague or contested
        blunder = "" if blunders is None else blunders.sentence
        extraordinary = best.extraordinary(settings.guard)
        found = (extraordinary, sentence or slip, misfit, ambiguous, blunder)
        objections = tuple(objection for objection in found if objection)
        few = bool(second or selection.alternatives or contested)
        only_blunders = blunders is not None and objections == (blunder,)
        return cls(
            best,
            blunders.hypotheses if blunders and only_blunders else tuple(other.hypothesis for other in others),
            fit,
            objections,
            extraordinary or slip or misfit or blunder,
            support(best.explanation, best.mixture),
            only_blunders or (few and not (extraordinary or misfit or slip)),
            second.bent_ns if second is not None and second.slip else best.bent_ns,
            -np.inf if blunders is None else blunders.log_image,
        )

    def alignment(self, links: Links, knowledge: str, settings: AlignmentSettings) -> FrameAlignment:
        """As it is reported of these links, of whose headings so much is known."""
        reason = self.objections[0] if self.objections else self.support
        return FrameAlignment(
            robot_a=links.robot_a,
            robot_b=links.robot_b,
            best=self.best.hypothesis,
            covariance=self.best.covariance,
            ambiguous=bool(self.objections),
            reason="; ".join((reason, *links.left_out)),
            best_alternative=self.others[0] if self.others else None,
            heading_knowledge=knowledge,
            likely_alternatives=self.others if self.likely else (),
            fit=self.fit.by_time,
            suspected_fault=self.fault,
            calibration=self.best.calibration,
            calibration_covariance=None if self.best.frames is None else self.best.frames.errors.covariance,
            strain=0.0 if self.best.frames is None else self.best.frames.strain.squared,
            bent_ns=self.bent_ns,
            strain_probability=self.best.strain_probability(settings.drift_inflation),
            log_image=self.log_image,
        )


def _rivals(best: Followed, others: Sequence[Followed], guard: AmbiguitySettings) -> tuple[Followed, ...]:
    """Those elsewhere that are nearly as likely once all follow drift and errors, the most likely first.

    Of mirror images, one rigid transform may fit far better by what a clock or a scale explains as well.
    """
    same_place_m = guard.same_place_fraction * best.mixture.observations.typical_distance_m
    rivals = [
        other
        for other in others
        # NaN, and so no rival, where one of them was not followed
        if best.log_evidence - other.log_evidence < np.log(guard.min_odds) and best.differs(other, same_place_m)
    ]
    return tuple(sorted(rivals, key=lambda other: -other.log_evidence))


def _contested(best: Followed, rival: Followed) -> str:
    """What is said of a rival."""
    odds = np.exp(best.log_evidence - rival.log_evidence)
    return (
        f"an alignment {best.apart_m(rival):.1f} m away is nearly as likely where odometry drifts and constant errors"
        f" are allowed for (odds {odds:.1f} to 1)"
    )
