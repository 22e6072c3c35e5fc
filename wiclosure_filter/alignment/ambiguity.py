"""Is an alignment certain enough to prune by?  If not, why not, in one sentence.

An alignment is called certain if it is observable (small covariance), if more was measured than it needs, if the odds
against every different alignment are long, and if so good an agreement would hardly come about by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wiclosure.types import BoolArray, FloatArray
from wiclosure.wiclosure_filter.alignment.mixture import Explanation, Mixture
from wiclosure.wiclosure_filter.alignment.refinement import Peaks, Prior, displacement_m, explained
from wiclosure.wiclosure_filter.alignment.settings import AlignmentSettings

_MOST_PLACES = 4  # the search follows six peaks to their tops: of more places than these it may have missed some


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the guard says of a set of peaks.

    Args:
        best: row of the peak to use.
        runner_up: row of the best different peak, or None.
        covariance: `(4, 4)` of the best state; peaks too near to be called different are folded in.
        ambiguous: true where the alignment must not be used to prune.
        reason: one sentence.
        rivals: rows of other peaks that are likely too, where they are few and clear: with `best` they hold the odds
            against all others, and against chance, that a certain alignment would.
    """

    best: int
    runner_up: int | None
    covariance: FloatArray
    ambiguous: bool
    reason: str
    rivals: tuple[int, ...] = ()

    @property
    def others(self) -> tuple[int, ...]:
        """Rows of different peaks, the best first: the rivals, or only the runner-up."""
        return self.rivals or (() if self.runner_up is None else (self.runner_up,))


def judge(
    peaks: Peaks,
    mixture: Mixture,
    prior: Prior,
    settings: AlignmentSettings,
    explanation: Explanation | None = None,
) -> Verdict:
    """Weighs the peaks of the posterior against each other, and the best against chance.

    Args:
        peaks: of the posterior.
        mixture: likelihood of the measurements.
        prior: what was known before.
        settings: when to refuse.
        explanation: of the measurements at each peak, where a level frame transform does not tell it.
    """
    guard, observations = settings.guard, mixture.observations
    evidence = log_evidence(peaks)
    best = int(np.argmax(evidence))
    distance = observations.typical_distance_m
    apart = displacement_m(peaks.states, peaks.states[best], observations)
    different = apart > guard.same_place_fraction * distance
    covariance = _covariance(peaks, evidence, best, ~different)
    runner_up = int(np.flatnonzero(different)[np.argmax(evidence[different])]) if different.any() else None

    explanation = explained(peaks.states[best], mixture) if explanation is None else explanation.at(best)
    little = _too_few(explanation, mixture, prior, settings)
    rival = _rivals(evidence, different, apart, settings)
    doubts = [
        _unobservable(covariance, distance, mixture, settings),
        little,
        rival,
        _chance(_log_mass(peaks, best, covariance), distance, prior, settings),
    ]
    reasons = [doubt for doubt in doubts if doubt]
    reason = reasons[0] if reasons else _support(explanation, mixture)
    rivals = _likely_rivals(peaks, evidence, best, mixture, prior, settings) if rival and not little else ()
    return Verdict(best, runner_up, covariance, bool(reasons), reason, rivals)


def log_evidence(peaks: Peaks) -> FloatArray:
    """`(N,)` logarithm of the posterior mass of each peak, up to a constant (Laplace's approximation)."""
    ridge = 1e-9 * np.trace(peaks.information, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    return np.asarray(peaks.log_posterior - np.linalg.slogdet(peaks.information + ridge)[1] / 2)


def _covariance(peaks: Peaks, evidence: FloatArray, best: int, near: BoolArray) -> FloatArray:
    """Covariance of the best state, with the spread of near peaks weighted by their mass."""
    information = peaks.information[best]
    covariance = np.linalg.inv(information + 1e-9 * np.trace(information) * np.eye(4))
    offset = peaks.states[near] - peaks.states[best]
    offset[:, 0] = (offset[:, 0] + np.pi) % (2 * np.pi) - np.pi
    mass = np.exp(evidence[near] - evidence[near].max())
    return np.asarray(covariance + (mass[:, None] * offset).T @ offset / mass.sum())


def _unobservable(covariance: FloatArray, distance: float, mixture: Mixture, settings: AlignmentSettings) -> str:
    guard = settings.guard
    moved_a, moved_b = mixture.observations.extents_m
    yaw_sigma = float(np.sqrt(covariance[0, 0]))
    if yaw_sigma > guard.max_yaw_sigma_rad:
        return (
            f"the relative heading is not observable (standard deviation {np.degrees(yaw_sigma):.0f} degrees):"
            f" the robots moved {moved_a:.1f} m and {moved_b:.1f} m while they heard each other"
        )
    position_sigma = float(np.sqrt(covariance[1, 1] + covariance[2, 2]))
    if position_sigma > guard.max_relative_sigma * distance:
        return (
            f"the relative position is too vague to prune (standard deviation {position_sigma:.1f} m over links of"
            f" {distance:.1f} m)"
        )
    return ""


def _too_few(explanation: Explanation, mixture: Mixture, prior: Prior, settings: AlignmentSettings) -> str:
    counted = mixture.observations.independence
    direct = explanation.path[0].sum(axis=-1)
    ranged = explanation.in_sight[0] + explanation.obstructed[0]
    numbers = float(((direct + ranged) * counted).sum())
    needed = 2 if np.isfinite(prior.yaw) else 3
    if numbers >= needed + settings.guard.min_redundancy:
        return ""
    return (
        f"too little was measured: {numbers:.1f} independent ranges and bearings agree where {needed} fix the"
        f" alignment and {settings.guard.min_redundancy:g} more would confirm it"
    )


def _rivals(evidence: FloatArray, different: BoolArray, apart: FloatArray, settings: AlignmentSettings) -> str:
    if not different.any():
        return ""
    log_odds = logsumexp(evidence[~different]) - logsumexp(evidence[different])
    odds = float(np.exp(min(log_odds, 50.0)))
    if odds >= settings.guard.min_odds:
        return ""
    rival = np.flatnonzero(different)[np.argmax(evidence[different])]
    return f"an alignment {apart[rival]:.1f} m away is nearly as likely (odds {odds:.1f} to 1)"


def _likely_rivals(
    peaks: Peaks, evidence: FloatArray, best: int, mixture: Mixture, prior: Prior, settings: AlignmentSettings
) -> tuple[int, ...]:
    """Places that with the best hold the odds against all others, and together explain more than chance.

    None where they are many, or one is vague.
    """
    guard, observations = settings.guard, mixture.observations
    distance = observations.typical_distance_m
    places, masses, left = [best], [], np.ones(len(peaks), bool)
    while len(places) <= _MOST_PLACES:
        apart = displacement_m(peaks.states, peaks.states[places[-1]], observations)
        here = apart <= guard.same_place_fraction * distance
        covariance = _covariance(peaks, evidence, places[-1], here)
        if _unobservable(covariance, distance, mixture, settings):
            return ()
        masses.append(_log_mass(peaks, places[-1], covariance))
        left &= ~here
        if not left.any() or logsumexp(evidence[~left]) - logsumexp(evidence[left]) >= np.log(guard.min_odds):
            return () if _chance(float(logsumexp(masses)), distance, prior, settings) else tuple(places[1:])
        places.append(int(np.flatnonzero(left)[np.argmax(evidence[left])]))
    return ()


def _log_mass(peaks: Peaks, row: int, covariance: FloatArray) -> float:
    """Logarithm of the posterior's integral over a peak."""
    return float(peaks.log_posterior[row] + np.linalg.slogdet(2 * np.pi * covariance)[1] / 2)


def _chance(log_mass: float, distance: float, prior: Prior, settings: AlignmentSettings) -> str:
    """Bayes factor of the alignment against "all that was measured is noise"."""
    searched = np.log(np.pi * (2 * distance) ** 2) + np.log(np.sqrt(2 * np.pi) * prior.height_sigma_m)
    searched += np.log(np.sqrt(2 * np.pi) * prior.yaw_sigma if np.isfinite(prior.yaw) else 2 * np.pi)
    if log_mass - searched >= np.log(settings.guard.min_odds):
        return ""
    return "the measurements agree no better than chance would have it"


def _support(explanation: Explanation, mixture: Mixture) -> str:
    direct = int((explanation.direct() >= 0).sum())
    ranged = int(explanation.ranged().sum())
    total = len(mixture.observations)
    return f"{direct} bearings and {ranged} ranges of {total} measurements agree"
