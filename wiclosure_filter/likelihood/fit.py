"""Does an alignment explain the measurements as well as an honest radio's would be explained?

The mixture is a generative model: it says how often the direct path is among the paths, and how bearings and ranges
scatter, and so how many of them an alignment should explain, and by how much that number varies.  Both are drawn from
the model with the measurements' own sigmas, weights and numbers of paths, and with the shares of missing direct paths
and of gross errors that radios show behind walls.  A systematic error (a mirrored angle, a wrong clock, a slip) leaves
an alignment that explains far less: what chance, or a part of the log, allows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import bdtrc, ndtr  # scipy.stats takes seconds to import

from wiclosure.types import AlignmentFit, FloatArray
from wiclosure.wiclosure_filter.likelihood.mixture import Explanation, Mixture

_DRAWS = 64
_SEED = 7
_SHORT = 4.0  # standard deviations by which a range is too short for a path that is never shorter than the direct one
_BINS = 12
_ASKED = " (are azimuths in radians, counter-clockwise from x forward, in the axes of aoa_frame?)"


@dataclass(frozen=True, eq=False)
class Share:
    """How many of some measurements agree; those from one place count as one.

    Args:
        counted: how many there are.
        agreeing: of them, expected number that the alignment explains.
        expected, sigma: the same of an honest radio behind walls, and its standard deviation.
    """

    counted: float
    agreeing: float
    expected: float
    sigma: float

    @property
    def probability(self) -> float:
        """That an honest radio agrees as little (normal approximation with continuity correction)."""
        return float(ndtr((self.agreeing + 0.5 - self.expected) / max(self.sigma, 0.5)))


@dataclass(frozen=True, eq=False)
class Fit:
    """How well an alignment explains the measurements.

    Args:
        bearings, ranges: shares that agree.
        short: ranges that are far shorter than the distance.
        short_probability: that gross errors make so many.
        by_time: the same by time.
    """

    bearings: Share
    ranges: Share
    short: int
    short_probability: float
    by_time: AlignmentFit

    @classmethod
    def of(cls, mixture: Mixture, explanation: Explanation, distance_m: FloatArray) -> Fit:
        """Of an alignment.

        Args:
            mixture: likelihood of M measurements.
            explanation: of them by the alignment; leading dimension 1.
            distance_m: `(M,)` of the antennas, by the alignment.
        """
        bearings, ranges = bearing_share(mixture, explanation), range_share(mixture, explanation)
        short, probability = short_ranges(mixture, explanation, distance_m)
        least = min(bearings.probability, ranges.probability, probability)
        return cls(bearings, ranges, short, probability, _by_time(mixture, explanation, least))

    @property
    def probability(self) -> float:
        """That an honest radio fits as badly, by the worst of the three counts."""
        return self.by_time.probability

    def misfit(self, least: float) -> str:
        """What does not fit, as a sentence; empty where the fit is at least so probable."""
        if self.probability >= least:
            return ""
        told = []
        if self.bearings.probability < least:
            told.append(_count("bearings", self.bearings) + ("" if self.ranges.probability < least else _ASKED))
        if self.ranges.probability < least:
            told.append(_count("ranges", self.ranges))
        if self.short_probability < least:
            told.append(
                f"{self.short} ranges are shorter than the distance, which neither obstacles nor reflections explain"
            )
        return "the measurements do not fit the best alignment: " + "; ".join(told)


def bearing_share(mixture: Mixture, explanation: Explanation) -> Share:
    """Of bearings: the probability that one of the paths is the direct one, summed over the measurements."""
    observations, radio = mixture.observations, mixture.radio
    rows = np.flatnonzero(observations.has_bearing)
    weight, kappa, peak = observations.weight[rows], mixture.kappa[rows], mixture.peak[rows]
    flat = observations.flat[rows]
    rng = np.random.default_rng(_SEED)
    shape = (_DRAWS, *weight.shape)
    chosen = (rng.uniform(size=shape[:2])[..., None] > np.cumsum(weight, axis=1)).sum(axis=-1)
    there = rng.uniform(size=shape[:2]) >= max(radio.direct_path_absent_at_worst, radio.direct_path_absent)
    direct = (np.arange(shape[2]) == chosen[..., None]) & there[..., None]
    at_direct = np.where(flat, rng.normal(size=shape) ** 2 / 2, rng.exponential(size=shape)) / kappa  # 1 - cosine
    elsewhere = np.where(flat, 1 - np.cos(rng.uniform(0, np.pi, shape)), rng.uniform(0, 2, shape))
    density = (peak * np.exp(-kappa * np.where(direct, at_direct, elsewhere))).sum(axis=-1)
    drawn = density / (max(radio.direct_path_absent, 1e-12) + density)
    return _share(observations.independence[rows], explanation.path[0, rows].sum(axis=-1), drawn)


def range_share(mixture: Mixture, explanation: Explanation) -> Share:
    """Of ranges: the probability that it is no gross error, summed over the measurements."""
    radio = mixture.radio
    rows = np.flatnonzero(np.isfinite(mixture.observations.range_m))
    ranged = mixture.subset(rows)
    sigma = np.sqrt(ranged.range_variance)
    rng = np.random.default_rng(_SEED)
    shape = (_DRAWS, len(rows))
    longer = radio.range_bias_m + np.hypot(sigma, radio.range_bias_m) * rng.normal(size=shape)
    excess = np.where(rng.uniform(size=shape) < radio.range_biased, longer, sigma * rng.normal(size=shape))
    gross = rng.uniform(size=shape) < max(radio.range_outlier_at_worst, radio.range_outlier)
    excess = np.where(gross, radio.range_reach_m, excess)
    total, in_sight, obstructed = ranged.ranges(ranged.observations.range_m - excess)
    agreeing = explanation.in_sight[0, rows] + explanation.obstructed[0, rows]
    return _share(ranged.observations.independence, agreeing, (in_sight + obstructed) / np.maximum(total, 1e-300))


def short_ranges(mixture: Mixture, explanation: Explanation, distance_m: FloatArray) -> tuple[int, float]:
    """Ranges far shorter than the distance, and the probability of so many.

    Obstacles and reflections lengthen a path, and nothing shortens it.  What the ranges that agree scatter more than
    they say is granted to all of them.
    """
    rows = np.flatnonzero(np.isfinite(mixture.observations.range_m))
    if len(rows) == 0:
        return 0, 1.0
    standardised = (mixture.observations.range_m - distance_m)[rows] / np.sqrt(mixture.range_variance[rows])
    agreeing = explanation.in_sight[0, rows] > 0.5
    scatter = max(1.0, 1.4826 * float(np.median(np.abs(standardised[agreeing])))) if agreeing.any() else 1.0
    counted = mixture.observations.independence[rows]
    short = standardised < -_SHORT * scatter
    chance = mixture.radio.range_outlier / 2 + float(ndtr(-_SHORT))  # gross errors are as often too short
    number, total = int(np.ceil((counted * short).sum() - 1e-9)), int(np.ceil(counted.sum()))
    return int(short.sum()), (float(bdtrc(number - 1, total, chance)) if number else 1.0)


def _by_time(mixture: Mixture, explanation: Explanation, probability: float) -> AlignmentFit:
    observations = mixture.observations
    first, last = int(observations.stamp_ns.min()), int(observations.stamp_ns.max())
    count = min(_BINS, len(observations))
    starts = first + np.arange(count, dtype=np.int64) * ((last - first) // count + 1)
    of_bin = np.searchsorted(starts, observations.stamp_ns, side="right") - 1
    ranged = np.isfinite(observations.range_m)
    bearings, direct, ranges, agreeing = (
        np.bincount(of_bin[chosen], minlength=count)
        for chosen in (
            observations.has_bearing,
            explanation.direct() >= 0,
            ranged,
            ranged & explanation.ranged(),
        )
    )
    return AlignmentFit(starts, bearings, direct, ranges, agreeing, probability)


def _share(counted: FloatArray, agreeing: FloatArray, drawn: FloatArray) -> Share:
    """From weights `(M,)`, what agrees `(M,)` and what would agree `(D, M)`."""
    mean, variance = drawn.mean(axis=0), drawn.var(axis=0)
    return Share(
        float(counted.sum()), float(counted @ agreeing), float(counted @ mean), float(np.sqrt(counted**2 @ variance))
    )


def _count(what: str, share: Share) -> str:
    least = max(share.expected - 2 * share.sigma, 0.0)
    return f"{share.agreeing:.0f} of {share.counted:.0f} {what} agree where {least:.0f} or more should"
