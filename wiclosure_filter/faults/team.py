"""Three robots or more check each other: alignments around a cycle must add up to none.

Alignments of mixed-up robots can each look right.  From a to b, on to c, and back to a, they then do not end where they
began.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.special import logsumexp

from wiclosure import se3
from wiclosure.types import FrameAlignment, Trajectory, WirelessLog, robot_pairs
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.faults.corrections import Correction, RadioInputs, swapped
from wiclosure.wiclosure_filter.faults.diagnosis import LIKELIER, quick_settings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks

_MOST_ROBOTS = 4  # of larger teams there are too many orders to try
_SIGMAS = 4.0
_MIXED_UP = 0.02  # odds of each other order of the names


def contradictions(
    alignments: Mapping[tuple[str, str], FrameAlignment], trajectories: Mapping[str, Trajectory], inflation: float
) -> dict[tuple[str, str], str]:
    """Certain alignments that do not add up around a cycle of three, with a sentence each.

    Args:
        alignments: by pair of robots, a before b in the order of the trajectories.
        trajectories: of all robots.
        inflation: factor on the odometry's standard deviations.
    """
    certain = {pair: alignment for pair, alignment in alignments.items() if not alignment.ambiguous}
    found: dict[tuple[str, str], str] = {}
    for a, b, c in _triangles(list(trajectories), certain):
        cycle = ((a, b), (b, c), (a, c))
        metres, sigma = _gap_m([certain[pair] for pair in cycle], {r: trajectories[r] for r in (a, b, c)}, inflation)
        if metres > _SIGMAS * sigma:
            sentence = (
                f"the alignments of {a}, {b} and {c} contradict each other by {metres:.0f} m (sigma {sigma:.1f} m)"
            )
            found |= dict.fromkeys(cycle, sentence)
    return found


def _triangles(robots: Sequence[str], pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str, str]]:
    """Three robots each of which all pairs are given, in order; a large team has few of all that there could be."""
    order = {robot: number for number, robot in enumerate(robots)}
    later: dict[str, set[str]] = defaultdict(set)
    for a, b in pairs:
        later[a].add(b)
    found = [(a, b, c) for a, after_a in list(later.items()) for b in after_a for c in after_a & later.get(b, set())]
    return sorted(found, key=lambda cycle: [order[robot] for robot in cycle])


def _gap_m(
    cycle: Sequence[FrameAlignment], trajectories: Mapping[str, Trajectory], inflation: float
) -> tuple[float, float]:
    """How far apart the two ways around put c's path, where they agree best, and the standard deviation of that.

    Args:
        cycle: alignments of a and b, b and c, a and c.
        trajectories: of the three.
        inflation: factor on the odometry's standard deviations.
    """
    ab, bc, ac = (alignment.best.T_a_b for alignment in cycle if alignment.best is not None)
    c = list(trajectories.values())[2].positions
    gaps = np.linalg.norm((se3.transform(ab @ bc, c) - se3.transform(ac, c))[:, :2], axis=1)
    nearest = int(np.argmin(gaps))  # elsewhere the odometry may have turned
    points = (se3.transform(bc, c[nearest]), c[nearest], c[nearest])
    variance = _drift_variance(trajectories, inflation)
    for alignment, point in zip(cycle, points, strict=True):
        assert alignment.covariance is not None  # it is certain
        by_errors = np.hstack([-se3.skew(point), np.eye(3)])
        variance += float(np.trace((by_errors @ alignment.covariance @ by_errors.T)[:2, :2]))
    return float(gaps[nearest]), float(np.sqrt(variance))


def _drift_variance(trajectories: Mapping[str, Trajectory], inflation: float) -> float:
    """Of all robots' paths from end to end: pairs meet at different times."""
    ends = (t.relative_covariance(np.array([0]), np.array([len(t) - 1]))[0] for t in trajectories.values())
    return inflation**2 * sum(float(np.trace(covariance[3:5, 3:5])) for covariance in ends)


@dataclass(frozen=True, eq=False)
class NameOrders:
    """The orders of names that a small team's log may have, with how likely the measurements are under each.

    Args:
        claimed: logarithm of the likelihood by what the log claims.
        others: the same with each other order.
    """

    claimed: float = -np.inf
    others: tuple[tuple[float, Correction], ...] = ()

    @classmethod
    def of(
        cls,
        alignments: Mapping[tuple[str, str], FrameAlignment],
        trajectories: Mapping[str, Trajectory],
        log: WirelessLog,
        settings: AlignmentSettings,
    ) -> NameOrders:
        """None of them where the team is no small one, or nothing about any two robots is in doubt.

        Args:
            alignments: by what the log claims.
            trajectories: of all robots.
            log: all measurements.
            settings: of the alignment.
        """
        robots = list(trajectories)
        doubted = any(alignment.suspected_fault for alignment in alignments.values())
        if not 3 <= len(robots) <= _MOST_ROBOTS or not doubted:
            return cls()
        quick = quick_settings(settings)
        orders = [dict(zip(robots, order, strict=True)) for order in permutations(robots) if list(order) != robots]
        likely = [(_log_likelihood(c.apply((trajectories, log)), quick), c) for c in map(swapped, orders)]
        return cls(_log_likelihood((trajectories, log), quick), tuple(likely))

    @property
    def mixed_up(self) -> Correction | None:
        """The order under which the measurements fit far better, or None."""
        if not self.others:
            return None
        best, correction = max(self.others, key=lambda one: one[0])
        return correction if best - max(self.claimed, 0.0) > LIKELIER else None

    def objection(self, min_odds: float) -> str:
        """That other orders fit as well, as a sentence; empty where the odds are against all of them.

        An order against which the measurements do not hold these odds counts in full: between such orders decides
        how each one's drift happened to fit, not who is who.
        """
        if not self.others or not np.isfinite(self.claimed):
            return ""
        log_odds = np.array([log_likelihood for log_likelihood, _ in self.others]) - self.claimed
        log_odds = np.where(log_odds > -np.log(min_odds), np.maximum(log_odds, 0.0), log_odds)
        if logsumexp(log_odds) + np.log(_MIXED_UP) < -np.log(min_odds):
            return ""
        _, likeliest = max(self.others, key=lambda one: one[0])
        return f"the measurements of the whole team fit as well otherwise: {likeliest.fault}"


def _log_likelihood(inputs: RadioInputs, settings: AlignmentSettings) -> float:
    """Of a whole team's measurements; -inf where some do not fit, or contradict each other."""
    trajectories, log = inputs
    links = TeamLinks.of(trajectories, log, GatheringLimits.of(settings)).by_pair
    alignments = {pair: align(links[pair], trajectories, settings) for pair in robot_pairs(list(trajectories))}
    heard = [alignment for alignment in alignments.values() if alignment.best is not None]
    if any(alignment.suspected_fault for alignment in heard):
        return -np.inf
    if contradictions(alignments, trajectories, settings.drift_inflation):
        return -np.inf
    return float(sum(one.best.log_likelihood - one.strain / 2 for one in heard if one.best is not None))
