"""How the odometry frames of two robots lie, from their links; or a sentence on why the links do not tell."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, FrameAlignment, Trajectory
from wiclosure.wiclosure_filter.alignment.ambiguity import Selection, assess, support
from wiclosure.wiclosure_filter.alignment.drifting_frames import DriftingFrames, RigidTransform, follow_drifts
from wiclosure.wiclosure_filter.alignment.followed import Followed, follow, paths_kept, rigid_transform
from wiclosure.wiclosure_filter.alignment.indistinguishable import Blunders
from wiclosure.wiclosure_filter.alignment.roles import as_named, with_reference_first
from wiclosure.wiclosure_filter.alignment.second_alignment import SecondAlignment, second_alignment
from wiclosure.wiclosure_filter.config import AlignmentSettings, AmbiguitySettings
from wiclosure.wiclosure_filter.consensus.consensus import AnchoredPeaks, consensus
from wiclosure.wiclosure_filter.consensus.pairwise_consistency import pairwise_consistency
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem, PairOdometry
from wiclosure.wiclosure_filter.consensus.spatial_refinement import refine_in_space
from wiclosure.wiclosure_filter.likelihood.fit import Fit
from wiclosure.wiclosure_filter.links.links import Links

_NOTHING_FOUND = {
    "consensus": "no two measurements allow an alignment ({knowledge})",
    "pcm": "pairwise consistency needs ranges, bearings and relative headings ({knowledge}); use multipath: consensus",
}


def align(links: Links, trajectories: Mapping[str, Trajectory], settings: AlignmentSettings) -> FrameAlignment:
    """Aligns the odometry frames of two robots.

    Args:
        links: all that they measured of each other; `paths_kept` of the result refers to the log they come from.
        trajectories: odometry of each robot in its own frame.
        settings: what is assumed of the radio, how hard to search, when to refuse.
    """
    return align_together([(links, trajectories)], settings)[0]


def align_together(
    pairs: Iterable[tuple[Links, Mapping[str, Trajectory]]], settings: AlignmentSettings
) -> list[FrameAlignment]:
    """Alignments of many pairs of robots, of which drift is followed together: that is most of the work."""
    given = [*pairs]
    started = [_started(with_reference_first(links), trajectories, settings) for links, trajectories in given]
    frames = iter(follow_drifts([rigid for one in started if isinstance(one, _Peaks) for rigid in one.to_follow]))
    found = (one.alignment(frames) if isinstance(one, _Peaks) else one for one in started)
    return [as_named(one, links) for one, (links, _) in zip(found, given, strict=True)]


def _started(
    links: Links, trajectories: Mapping[str, Trajectory], settings: AlignmentSettings
) -> FrameAlignment | _Peaks:
    """As far as it goes without following drift."""
    links = links.thinned(settings.max_measurements)
    if len(links) == 0:
        return _unknown(links, "no measurement between the robots")
    problem = AlignmentProblem.of(links, trajectories, settings)
    knowledge = problem.heading_knowledge
    if settings.multipath == "pcm":
        found = pairwise_consistency(
            problem, settings.pcm_confidence, max_links=settings.max_pcm_links, height_ratio=settings.height_ratio
        )
    else:
        found = consensus(problem, settings.proposals)
    if found is None:
        return _unknown(links, _NOTHING_FOUND[settings.multipath].format(knowledge=knowledge), knowledge)
    if settings.gravity_aligned:
        return _Peaks.of(found, links, problem, settings)
    return _reported(_in_space(found, links, settings), links, knowledge, settings)


def _reported(chosen: _Chosen, links: Links, knowledge: str, settings: AlignmentSettings) -> FrameAlignment:
    reason = chosen.objections[0] if chosen.objections else chosen.support
    return FrameAlignment(
        robot_a=links.robot_a,
        robot_b=links.robot_b,
        best=chosen.best.hypothesis,
        covariance=chosen.best.covariance,
        ambiguous=bool(chosen.objections),
        reason="; ".join((reason, *links.left_out)),
        best_alternative=chosen.others[0] if chosen.others else None,
        heading_knowledge=knowledge,
        likely_alternatives=chosen.others if chosen.likely else (),
        fit=chosen.fit.by_time,
        suspected_fault=chosen.fault,
        calibration=chosen.best.calibration,
        calibration_covariance=None if chosen.best.frames is None else chosen.best.frames.errors.covariance,
        strain=0.0 if chosen.best.frames is None else chosen.best.frames.strain.squared,
        bent_ns=chosen.bent_ns,
        strain_probability=chosen.best.strain_probability(settings.drift_inflation),
        log_image=chosen.log_image,
    )


@dataclass(frozen=True, eq=False)
class _Chosen:
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
        indistinct: _Indistinct | None = None,
    ) -> _Chosen:
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
        blunder = "" if indistinct is None else indistinct.sentence
        extraordinary = best.extraordinary(settings.guard)
        found = (extraordinary, sentence or slip, misfit, ambiguous, blunder)
        objections = tuple(objection for objection in found if objection)
        few = bool(second or selection.alternatives or contested)
        only_blunders = indistinct is not None and objections == (blunder,)
        return cls(
            best,
            indistinct.hypotheses if indistinct and only_blunders else tuple(other.hypothesis for other in others),
            fit,
            objections,
            extraordinary or slip or misfit or blunder,
            support(best.explanation, best.mixture),
            only_blunders or (few and not (extraordinary or misfit or slip)),
            second.bent_ns if second is not None and second.slip else best.bent_ns,
            -np.inf if indistinct is None else indistinct.log_image,
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


@dataclass(frozen=True, eq=False)
class _Peaks:
    """Peaks between level frames, of which some are to be followed through the drift.

    Args:
        found: all of them.
        links: the measurements.
        problem: what was known of them.
        selection: which one to use.
        second: a second one that the measurements speak of besides.
        settings: of the alignment.
    """

    found: AnchoredPeaks
    links: Links
    problem: AlignmentProblem
    selection: Selection
    second: SecondAlignment | None
    settings: AlignmentSettings

    @classmethod
    def of(cls, found: AnchoredPeaks, links: Links, problem: AlignmentProblem, settings: AlignmentSettings) -> _Peaks:
        """Selects among the peaks."""
        selection, second = assess(found.peaks, found.mixture, found.prior, settings.guard), None
        if found.chosen is None and not selection.ambiguous:
            second = second_alignment(
                found, selection.best, selection.different, selection.log_volume, settings.guard.min_odds
            )
        return cls(found, links, problem, selection, second, settings)

    @property
    def rows(self) -> tuple[int, ...]:
        """Of the peaks that may be reported, the best first."""
        chosen = self.selection
        if self.second is not None:
            return chosen.best, self.second.row
        twin = () if chosen.ambiguous or chosen.twin is None else (chosen.twin,)
        return (chosen.best, *chosen.others, *twin)

    @property
    def _drifts(self) -> bool:
        return self.found.chosen is None and len(self.links) > 1

    @property
    def to_follow(self) -> list[RigidTransform]:
        """Those of the same peaks, or none where nothing is to be followed."""
        if not self._drifts:
            return []
        calibration = self.settings.calibration
        return [rigid_transform(self.found, row, self.problem.odometry, calibration) for row in self.rows]

    def alignment(self, frames: Iterator[DriftingFrames | None]) -> FrameAlignment:
        """From the chains that follow `to_follow`, the next ones of `frames`."""
        found, links, selection, guard = self.found, self.links, self.selection, self.settings.guard
        chains = [next(frames) if self._drifts else None for _ in self.rows]
        followed = [
            follow(found, row, links, chain, selection.covariance, guard)
            for row, chain in zip(self.rows, chains, strict=True)
        ]
        indistinct = None
        if not selection.ambiguous and guard.weigh_blunders:
            indistinct = _Indistinct.of(followed[0], found, links, self.problem.odometry, guard)
        chosen = _Chosen.of(selection, followed, self.second, self.settings, indistinct)
        return _reported(chosen, links, self.problem.heading_knowledge, self.settings)


@dataclass(frozen=True, eq=False)
class _Indistinct:
    """Blunders that would fit as well as the best alignment: a sentence, or empty, and the alignment under each.

    Of none where it may all be a reflection, which tells no place; `log_image` is how much likelier that makes it.
    """

    sentence: str
    hypotheses: tuple[AlignmentHypothesis, ...]
    log_image: float

    @classmethod
    def of(
        cls, best: Followed, found: AnchoredPeaks, links: Links, odometry: PairOdometry, guard: AmbiguitySettings
    ) -> _Indistinct | None:
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


def _in_space(found: AnchoredPeaks, links: Links, settings: AlignmentSettings) -> _Chosen:
    """Over all of SE(3)."""
    peaks = refine_in_space(found.peaks, found.mixture, found.prior, links, settings.tilt_sigma_rad)
    selection = assess(peaks.level, found.mixture, found.prior, settings.guard, peaks.explanation)
    followed = []
    for row in (selection.best, *selection.others):
        explanation, T_a_b = peaks.explanation.at(row), peaks.T_a_b[row]
        distance_m = np.linalg.norm(se3.transform(T_a_b, links.antenna_b) - links.antenna_a, axis=1)
        hypothesis = AlignmentHypothesis(
            T_a_b=T_a_b,
            log_likelihood=float(explanation.log_likelihood[0] @ found.mixture.observations.independence),
            paths_kept=paths_kept(explanation, links, None),
        )
        followed.append(Followed(hypothesis, peaks.covariance[row], found.mixture, explanation, distance_m))
    return _Chosen.of(selection, followed, None, settings)


def _unknown(links: Links, reason: str, knowledge: str = "none") -> FrameAlignment:
    because = "; ".join((reason, *links.left_out))
    return FrameAlignment(links.robot_a, links.robot_b, None, None, True, because, None, knowledge)
