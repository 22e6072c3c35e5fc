"""Consensus over the frame transform: propose, score against all measurements, climb, keep the distinct peaks.

Pairs of paths are too weak to vote on each other where relative heading is unknown: two links have one redundant degree
of freedom.  All measurements together are not.  Odometry drift is counted from an anchor, a measurement near the
proposal's own, so that a transform need not explain what lies hundreds of metres of odometry away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, IntArray, Trajectory
from wiclosure.wiclosure_filter.alignment import proposals
from wiclosure.wiclosure_filter.alignment.mixture import Mixture
from wiclosure.wiclosure_filter.alignment.observations import Observations, drift_from
from wiclosure.wiclosure_filter.alignment.proposals import Correspondences
from wiclosure.wiclosure_filter.alignment.refinement import Peaks, Prior, climb, displacement_m
from wiclosure.wiclosure_filter.alignment.settings import AlignmentSettings

_ANCHORS = 4
_QUICK_LOOK = 20  # measurements in the first scoring
_CLIMBERS = 48  # proposals that are refined, at few measurements
_CLIMBER_ROWS = 800  # proposals times measurements that are refined, at many
_ROWS_AN_ANCHOR = 25
_APART_M = 1.0  # proposals nearer than this climb to the same peak


@dataclass(frozen=True, eq=False)
class AnchoredPeaks:
    """Peaks of the posterior, best first, with the prior and the drift that they were found under.

    Args:
        peaks: N peaks.
        mixture: likelihood of the measurements.
        prior: what was known before.
        drift: standard deviations `(M,)` that the mixture allows for, see `observations.drift_from`.
        chosen: `(M,)` for each peak, the path kept of each measurement or -1, where the method decides that itself.
    """

    peaks: Peaks
    mixture: Mixture
    prior: Prior
    drift: tuple[FloatArray, FloatArray]
    chosen: tuple[IntArray, ...] | None = None


def consensus(
    observations: Observations,
    knowledge: str,
    partner: IntArray,
    trajectories: tuple[Trajectory, Trajectory],
    settings: AlignmentSettings,
) -> AnchoredPeaks | None:
    """The peaks of the posterior over frame transforms; None where no proposal can be made.

    Args:
        observations: the measurements.
        knowledge: `heading`, `reciprocal`, `one-way` or `range-only`.
        partner: `(M,)` the measurement the other way at about the same time, or -1.
        trajectories: of a and b.
        settings: how hard to search.
    """
    prior = Prior.of(observations, settings, knowledge == "heading")
    found: list[AnchoredPeaks] = []
    anchors = _anchors(observations)
    for anchor, rows in anchors:
        states = _proposed(observations, knowledge, partner, rows, prior, settings.proposals // len(anchors))
        if len(states):
            drift = drift_from(anchor, observations, trajectories, settings.drift_inflation)
            mixture = Mixture.of(observations, settings.radio, drift)
            peaks = climb(_promising(states, mixture, prior), mixture, prior)
            found.append(AnchoredPeaks(peaks.distinct(observations), mixture, prior, drift))
    return _joined(found)


def _joined(found: list[AnchoredPeaks]) -> AnchoredPeaks | None:
    """The peaks of all anchors under the drift of the best one, so that they can be compared."""
    if len(found) <= 1:
        return found[0] if found else None
    best = max(found, key=lambda one: float(one.peaks.log_posterior[0]))
    states = np.concatenate([one.peaks.states for one in found])
    peaks = climb(states, best.mixture, best.prior).distinct(best.mixture.observations)
    return AnchoredPeaks(peaks, best.mixture, best.prior, best.drift)


def _anchors(observations: Observations) -> list[tuple[int, IntArray]]:
    """Measurements to count drift from, each with the measurements around it that make proposals."""
    count = len(observations)
    groups = np.array_split(np.arange(count), max(1, min(_ANCHORS, count // _ROWS_AN_ANCHOR)))
    return [(int(group[len(group) // 2]), group) for group in groups]


def _proposed(
    observations: Observations, knowledge: str, partner: IntArray, rows: IntArray, prior: Prior, limit: int
) -> FloatArray:
    """Every kind of proposal that the measurements allow, `(N, 4)`."""
    points = Correspondences.of(observations)
    ranged, directed = np.isfinite(observations.range_m), observations.has_bearing
    if knowledge == "heading":
        known = np.array([prior.yaw + step * prior.yaw_sigma for step in (-1.0, 0.0, 1.0)])
        kinds = [
            proposals.from_known_yaw(
                points, np.full(len(points.row), prior.yaw), np.full(len(points.row), prior.yaw_sigma)
            )
        ]
        yaws = known
    else:
        kinds = [proposals.from_pairs(points, rows, limit)]
        yaws = proposals.yaw_grid()
    if knowledge == "reciprocal":
        kinds.append(proposals.from_reciprocal(points, observations, partner, limit))
    if len(points.row) == 0 and directed.any():
        kinds.append(proposals.from_rays(observations, rows, yaws, 2 * limit))
    if ranged.any() and not (directed & ranged).any():
        kinds.append(proposals.from_circles(observations, rows, yaws, 2 * limit))
    return np.concatenate(kinds)


def _promising(states: FloatArray, mixture: Mixture, prior: Prior) -> FloatArray:
    """The proposals worth refining: scored on some measurements first, the best of them on all."""
    count = len(mixture.observations)
    climbers = max(8, min(_CLIMBERS, _CLIMBER_ROWS // count))
    if count > 2 * _QUICK_LOOK and len(states) > 10 * climbers:
        some = np.linspace(0, count - 1, _QUICK_LOOK).astype(np.int64)
        quick = mixture.subset(some).log_likelihood(states) + prior.log_density(states)
        states = states[np.argsort(-quick, kind="stable")[: 10 * climbers]]
    score = mixture.log_likelihood(states) + prior.log_density(states)
    return _apart(states[np.argsort(-score, kind="stable")], mixture.observations, climbers)


def _apart(states: FloatArray, observations: Observations, limit: int) -> FloatArray:
    """The first `limit` states of which no two are nearly the same."""
    states = states[: 20 * limit]
    free = np.ones(len(states), bool)
    kept: list[int] = []
    while free.any() and len(kept) < limit:
        kept.append(int(np.argmax(free)))
        free &= displacement_m(states, states[kept[-1]], observations) > _APART_M
    return states[kept]
