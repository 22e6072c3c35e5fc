"""Which order of the names a small team's log has: that under which all its measurements fit, and add up.

Alignments of mixed-up robots can each look right.  Around a cycle they then do not add up, unless all are mixed up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.special import logsumexp

from wiclosure.types import FrameAlignment, Trajectory, WirelessLog, robot_pairs
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.faults.corrections import Correction, RadioInputs, swapped
from wiclosure.wiclosure_filter.faults.cycles import Cycles
from wiclosure.wiclosure_filter.faults.diagnosis import LIKELIER, quick_settings
from wiclosure.wiclosure_filter.faults.renamed import Displacements, missed
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

_MOST_ROBOTS = 4  # of larger teams there are too many orders to try
_MIXED_UP = 0.02  # odds of each other order of the names


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
        links: Mapping[tuple[str, str], Links],
        trajectories: Mapping[str, Trajectory],
        log: WirelessLog,
        settings: AlignmentSettings,
    ) -> NameOrders:
        """None of them where the team is no small one, or nothing about any two robots is in doubt.

        Args:
            alignments: by what the log claims, with what third robots refute: under another order they may err too.
            links: of each pair.
            trajectories: of all robots.
            log: all measurements.
            settings: of the alignment.
        """
        robots = list(trajectories)
        doubted = [alignment for alignment in alignments.values() if alignment.suspected_fault]
        if not 3 <= len(robots) <= _MOST_ROBOTS or not doubted:
            return cls()
        quick = quick_settings(settings)
        orders = [dict(zip(robots, order, strict=True)) for order in permutations(robots) if list(order) != robots]
        if all(alignment.only_blunders for alignment in doubted):  # all fit: geometry tells what else may
            told = [Displacements.of(alignment, links[pair]) for pair, alignment in alignments.items()]
            orders = [order for order in orders if missed(told, order, trajectories) < 2 * LIKELIER]
        likely = [(_log_likelihood(c.apply((trajectories, log)), quick), c) for c in map(swapped, orders)]
        if all(log_likelihood == -np.inf for log_likelihood, _ in likely):
            return cls()
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
    alignments = {}
    for pair in robot_pairs(list(trajectories)):
        alignments[pair] = align(links[pair], trajectories, settings)
        if alignments[pair].suspected_fault:
            return -np.inf
    heard = [alignment for alignment in alignments.values() if alignment.best is not None]
    if Cycles(alignments, links, trajectories, settings.drift_inflation).contradictions():
        return -np.inf
    return float(sum(one.best.log_likelihood - one.strain / 2 for one in heard if one.best is not None))
