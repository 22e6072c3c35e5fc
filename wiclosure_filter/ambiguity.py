"""Is an alignment certain enough to prune by?  If not, why not, in one sentence.

An alignment is called certain if it is observable (small covariance), if more was measured than it needs, if the odds
against every different alignment are long, and if so good an agreement would hardly come about by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.alignment_settings import AlignmentSettings
from wiclosure.wiclosure_filter.links import BoolArray
from wiclosure.wiclosure_filter.mixture import Explanation, Mixture
from wiclosure.wiclosure_filter.refinement import Peaks, Prior, displacement_m, explained


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the guard says of a set of peaks.

    Args:
        best: row of the peak to use.
        runner_up: row of the best different peak, or None.
        covariance: `(4, 4)` of the best state; peaks too near to be called different are folded in.
        ambiguous: true where the alignment must not be used to prune.
        reason: one sentence.
    """

    best: int
    runner_up: int | None
    covariance: FloatArray
    ambiguous: bool
    reason: str


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
    doubts = [
        _unobservable(covariance, distance, mixture, settings),
        _too_few(explanation, mixture, prior, settings),
        _rivals(evidence, different, apart, settings),
        _chance(float(peaks.log_posterior[best]), covariance, distance, prior, settings),
    ]
    reasons = [doubt for doubt in doubts if doubt]
    reason = reasons[0] if reasons else _support(explanation, mixture)
    return Verdict(best, runner_up, covariance, bool(reasons), reason)


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


def _chance(value: float, covariance: FloatArray, distance: float, prior: Prior, settings: AlignmentSettings) -> str:
    """Bayes factor of the alignment against "all that was measured is noise"."""
    searched = np.log(np.pi * (2 * distance) ** 2) + np.log(np.sqrt(2 * np.pi) * prior.height_sigma_m)
    searched += np.log(np.sqrt(2 * np.pi) * prior.yaw_sigma if np.isfinite(prior.yaw) else 2 * np.pi)
    mass = value + np.linalg.slogdet(2 * np.pi * covariance)[1] / 2
    if mass - searched >= np.log(settings.guard.min_odds):
        return ""
    return "the measurements agree no better than chance would have it"


def _support(explanation: Explanation, mixture: Mixture) -> str:
    direct = int((explanation.direct() >= 0).sum())
    ranged = int(explanation.ranged().sum())
    total = len(mixture.observations)
    return f"{direct} bearings and {ranged} ranges of {total} measurements agree"
