"""Is an alignment certain enough to prune by?  If not, why not, in one sentence.

An alignment is called certain if it is observable (small covariance), if more was measured than it needs, if the odds
against every different alignment are high, and if so good an agreement would hardly come about by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray
from wiclosure.wiclosure_filter.config import AmbiguitySettings
from wiclosure.wiclosure_filter.consensus.refinement import Peaks, Prior, displacement_m
from wiclosure.wiclosure_filter.likelihood.mixture import Explanation, Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
from wiclosure.wiclosure_filter.likelihood.residuals import explained

_MOST_PLACES = 4  # the search follows six peaks to their tops: of more places than these it may have missed some


@dataclass(frozen=True, eq=False)
class Selection:
    """Which of a set of peaks to use, and whether it is certain.

    Args:
        best: row of the peak to use.
        second: row of the best different peak, or None.
        covariance: `(4, 4)` of the best state; peaks too near to be called different are folded in.
        ambiguous: true where the alignment must not be used to prune.
        reason: one sentence.
        different: `(N,)` peaks that are no neighbours of the best.
        log_volume: `(N,)` logarithm of the part of all that was searched that each peak takes.
        alternatives: rows of other peaks that are likely too, where they are few and clear: with `best` they hold the
            odds against all others, and against chance, that a certain alignment would.
        twin: row of the best peak beside the best one, or None: where ranges alone tell, of two mirror images on either
            side of a nearly straight path.
    """

    best: int
    second: int | None
    covariance: FloatArray
    ambiguous: bool
    reason: str
    different: BoolArray
    log_volume: FloatArray
    alternatives: tuple[int, ...] = ()
    twin: int | None = None

    @property
    def others(self) -> tuple[int, ...]:
        """Rows of different peaks, the best first: the likely alternatives, or only the second best."""
        return self.alternatives or (() if self.second is None else (self.second,))


def assess(
    peaks: Peaks,
    mixture: Mixture,
    prior: Prior,
    guard: AmbiguitySettings,
    explanation: Explanation | None = None,
) -> Selection:
    """Weighs the peaks of the posterior against each other, and the best against chance.

    Args:
        peaks: of the posterior.
        mixture: likelihood of the measurements.
        prior: what was known before.
        guard: when to refuse.
        explanation: of the measurements at each peak, where a level frame transform does not tell it.
    """
    weighed = _WeighedPeaks(peaks, log_evidence(peaks), mixture, prior, guard)
    best = int(np.argmax(weighed.evidence))
    apart_m = weighed.apart_m(best)
    different = apart_m > weighed.same_place_m
    covariance = weighed.covariance(best, ~different)
    second = weighed.best_of(different)
    beside = ~different
    beside[best] = False
    explanation = explained(peaks.states[best], mixture) if explanation is None else explanation.at(best)
    little = weighed.too_few(explanation)
    contested = weighed.contested(different, apart_m)
    objections = [
        weighed.unobservable(covariance),
        little,
        contested,
        weighed.by_chance(weighed.log_mass(best, covariance)),
    ]
    reasons = [objection for objection in objections if objection]
    reason = reasons[0] if reasons else support(explanation, mixture)
    alternatives = weighed.likely_alternatives(best) if contested and not little else ()
    log_volume = weighed.evidence - peaks.log_posterior + 2 * np.log(2 * np.pi) - weighed.log_searched
    return Selection(
        best, second, covariance, bool(reasons), reason, different, log_volume, alternatives, weighed.best_of(beside)
    )


def log_evidence(peaks: Peaks) -> FloatArray:
    """`(N,)` logarithm of the posterior mass of each peak, up to a constant (Laplace's approximation)."""
    ridge = 1e-9 * np.trace(peaks.information, axis1=1, axis2=2)[:, None, None] * np.eye(4)
    return np.asarray(peaks.log_posterior - np.linalg.slogdet(peaks.information + ridge)[1] / 2)


def unobservable(covariance: FloatArray, observations: Observations, guard: AmbiguitySettings) -> str:
    """Whether yaw or position is vague by the covariance `(4, 4)` of a state: a sentence, or empty."""
    moved_a, moved_b = observations.extents_m
    yaw_sigma = float(np.sqrt(covariance[0, 0]))
    if yaw_sigma > guard.max_yaw_sigma_rad:
        return (
            f"the relative heading is not observable (standard deviation {np.degrees(yaw_sigma):.0f} degrees):"
            f" the robots moved {moved_a:.1f} m and {moved_b:.1f} m while they heard each other"
        )
    distance_m = observations.typical_distance_m
    position_sigma = float(np.sqrt(covariance[1, 1] + covariance[2, 2]))
    if position_sigma > guard.max_relative_sigma * distance_m:
        return (
            f"the relative position is too vague to prune (standard deviation {position_sigma:.1f} m over links of"
            f" {distance_m:.1f} m)"
        )
    return ""


@dataclass(frozen=True, eq=False)
class _WeighedPeaks:
    """Peaks with the logarithm of each one's posterior mass `(N,)`, and the doubts that they leave as sentences."""

    peaks: Peaks
    evidence: FloatArray
    mixture: Mixture
    prior: Prior
    guard: AmbiguitySettings

    @property
    def distance_m(self) -> float:
        """Usual distance between the robots."""
        return self.mixture.observations.typical_distance_m

    @property
    def same_place_m(self) -> float:
        """Distance up to which two alignments count as one."""
        return self.guard.same_place_fraction * self.distance_m

    def apart_m(self, row: int) -> FloatArray:
        """How far `(N,)` the peaks are from one of them."""
        return displacement_m(self.peaks.states, self.peaks.states[row], self.mixture.observations)

    def best_of(self, rows: BoolArray) -> int | None:
        """The likeliest of some peaks; None of none."""
        return int(np.flatnonzero(rows)[np.argmax(self.evidence[rows])]) if rows.any() else None

    def covariance(self, row: int, near: BoolArray) -> FloatArray:
        """Covariance `(4, 4)` of a state, with the spread of the peaks near it weighted by their mass."""
        information = self.peaks.information[row]
        covariance = np.linalg.inv(information + 1e-9 * np.trace(information) * np.eye(4))
        offset = self.peaks.states[near] - self.peaks.states[row]
        offset[:, 0] = se3.wrap_angle(offset[:, 0])
        mass = np.exp(self.evidence[near] - self.evidence[near].max())
        return np.asarray(covariance + (mass[:, None] * offset).T @ offset / mass.sum())

    def log_mass(self, row: int, covariance: FloatArray) -> float:
        """Logarithm of the posterior's integral over a peak."""
        return float(self.peaks.log_posterior[row] + np.linalg.slogdet(2 * np.pi * covariance)[1] / 2)

    def unobservable(self, covariance: FloatArray) -> str:
        """Whether yaw or position is vague."""
        return unobservable(covariance, self.mixture.observations, self.guard)

    def too_few(self, explanation: Explanation) -> str:
        """Whether more was measured than the alignment needs."""
        counted = self.mixture.observations.independence
        direct = explanation.path[0].sum(axis=-1)
        ranged = explanation.in_sight[0] + explanation.obstructed[0]
        numbers = float(((direct + ranged) * counted).sum())
        needed = 2 if np.isfinite(self.prior.yaw) else 3
        if numbers >= needed + self.guard.min_redundancy:
            return ""
        return (
            f"too little was measured: {numbers:.1f} independent ranges and bearings agree where {needed} fix the"
            f" alignment and {self.guard.min_redundancy:g} more would confirm it"
        )

    def contested(self, different: BoolArray, apart_m: FloatArray) -> str:
        """Whether a different alignment is nearly as likely."""
        if not different.any():
            return ""
        log_odds = logsumexp(self.evidence[~different]) - logsumexp(self.evidence[different])
        odds = float(np.exp(min(log_odds, 50.0)))
        if odds >= self.guard.min_odds:
            return ""
        second = np.flatnonzero(different)[np.argmax(self.evidence[different])]
        return f"an alignment {apart_m[second]:.1f} m away is nearly as likely (odds {odds:.1f} to 1)"

    @property
    def log_searched(self) -> float:
        """Logarithm of the volume of alignments that were possible before."""
        searched = np.log(np.pi * (2 * self.distance_m) ** 2)
        searched += np.log(np.sqrt(2 * np.pi) * self.prior.height_sigma_m)
        known = np.isfinite(self.prior.yaw)
        return float(searched + np.log(np.sqrt(2 * np.pi) * self.prior.yaw_sigma if known else 2 * np.pi))

    def by_chance(self, log_mass: float) -> str:
        """Bayes factor of the alignment against "all that was measured is noise"."""
        if log_mass - self.log_searched >= np.log(self.guard.min_odds):
            return ""
        return "the measurements agree no better than chance would have it"

    def likely_alternatives(self, best: int) -> tuple[int, ...]:
        """Places that with the best hold the odds against all others, and together explain more than chance.

        None where they are many, or one is vague.
        """
        places, masses, left = [best], [], np.ones(len(self.peaks), bool)
        while len(places) <= _MOST_PLACES:
            here = self.apart_m(places[-1]) <= self.same_place_m
            covariance = self.covariance(places[-1], here)
            if self.unobservable(covariance):
                return ()
            masses.append(self.log_mass(places[-1], covariance))
            left &= ~here
            if not left.any() or (
                logsumexp(self.evidence[~left]) - logsumexp(self.evidence[left]) >= np.log(self.guard.min_odds)
            ):
                return () if self.by_chance(float(logsumexp(masses))) else tuple(places[1:])
            places.append(int(np.flatnonzero(left)[np.argmax(self.evidence[left])]))
        return ()


def support(explanation: Explanation, mixture: Mixture) -> str:
    """How many measurements agree with the alignment that explains them so, as a clause."""
    direct = int((explanation.direct() >= 0).sum())
    ranged = int(explanation.ranged().sum())
    total = len(mixture.observations)
    return f"{direct} bearings and {ranged} ranges of {total} measurements agree"
