"""Consensus over the frame transform: propose, score against all measurements, climb, keep the distinct peaks.

Pairs of paths are too weak to vote on each other where relative heading is unknown: two links have one redundant degree
of freedom.  All measurements together are not.  Odometry drift is counted from an anchor, a measurement near the
proposal's own, so that a transform need not explain what lies hundreds of metres of odometry away.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.consensus import proposals
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem
from wiclosure.wiclosure_filter.consensus.proposals import Correspondences
from wiclosure.wiclosure_filter.consensus.refinement import Peaks, Prior, climb, displacement_m, first_distinct
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations

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
        drift: standard deviations `(M,)` that the mixture allows for, see `PairOdometry.drift_from`.
        chosen: `(M,)` for each peak, the path kept of each measurement or -1, where the method decides that itself.
    """

    peaks: Peaks
    mixture: Mixture
    prior: Prior
    drift: tuple[FloatArray, FloatArray]
    chosen: tuple[IntArray, ...] | None = None


def consensus(problem: AlignmentProblem, proposals_at_most: int) -> AnchoredPeaks | None:
    """The peaks of the posterior over frame transforms; None where no proposal can be made.

    Args:
        problem: measurements, odometry and priors of two robots.
        proposals_at_most: frame transforms that are scored.
    """
    found: list[AnchoredPeaks] = []
    anchors = _anchors(problem.observations)
    for anchor, rows in anchors:
        states = _proposed(problem, rows, proposals_at_most // len(anchors))
        if len(states):
            mixture, drift = problem.anchored_at(anchor)
            peaks = climb(_promising(states, mixture, problem.prior), mixture, problem.prior)
            found.append(AnchoredPeaks(peaks.distinct(problem.observations), mixture, problem.prior, drift))
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


def _proposed(problem: AlignmentProblem, rows: IntArray, limit: int) -> FloatArray:
    """Every kind of proposal that the measurements allow, `(N, 4)`."""
    observations, prior = problem.observations, problem.prior
    points = Correspondences.of(observations)
    ranged, directed = np.isfinite(observations.range_m), observations.has_bearing
    if problem.heading_knowledge == "heading":
        kinds = [proposals.from_known_yaw(points, prior.yaw, prior.yaw_sigma)]
        yaws = np.array([prior.yaw + step * prior.yaw_sigma for step in (-1.0, 0.0, 1.0)])
    else:
        kinds = [proposals.from_pairs(points, rows, limit)]
        yaws = proposals.yaw_grid()
    if problem.heading_knowledge == "reciprocal":
        kinds.append(proposals.from_reciprocal(points, observations, problem.partner, limit))
    if len(points.row) == 0 and directed.any():
        kinds.append(proposals.from_rays(observations, rows, yaws, 2 * limit))
    if ranged.any() and not (directed & ranged).any():
        kinds.append(proposals.from_circles(observations, rows, yaws, 2 * limit))
    return np.concatenate(kinds)


def _promising(states: FloatArray, mixture: Mixture, prior: Prior) -> FloatArray:
    """The most likely proposals: scored on some measurements first, the best of them on all."""
    count = len(mixture.observations)
    climbers = max(8, min(_CLIMBERS, _CLIMBER_ROWS // count))
    if count > 2 * _QUICK_LOOK and len(states) > 10 * climbers:
        some = np.linspace(0, count - 1, _QUICK_LOOK).astype(np.int64)
        quick = mixture.subset(some).log_likelihood(states) + prior.log_density(states)
        states = states[np.argsort(-quick, kind="stable")[: 10 * climbers]]
    score = mixture.log_likelihood(states) + prior.log_density(states)
    states = states[np.argsort(-score, kind="stable")][: 20 * climbers]
    observations = mixture.observations
    return states[
        first_distinct(
            len(states), lambda row: displacement_m(states, states[row], observations), _APART_M, limit=climbers
        )
    ]
