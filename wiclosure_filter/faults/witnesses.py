"""Measurements that a joint estimate does not rest on are its witnesses.

A robot that slips bends its alignment with each other robot, and one of these may look right by itself.  Those of its
measurements that are in doubt then lie far from where the estimate puts them.  An alignment that closes a cycle with
others is confirmed by these; one that hangs alone stands against the witness.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TypeAlias

import networkx as nx
import numpy as np

from wiclosure.types import FrameAlignment, Trajectory
from wiclosure.wiclosure_filter.alignment.radio_check import RadioConsistencyCheck
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.faults.diagnosis import LIKELIER
from wiclosure.wiclosure_filter.links.links import Links
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedEstimate, SharedTrajectory

RobotPair: TypeAlias = tuple[str, str]


def refuted(
    shared: SharedTrajectory,
    alignments: Mapping[RobotPair, FrameAlignment],
    links: Mapping[RobotPair, Links],
    trajectories: Mapping[str, Trajectory],
    settings: AlignmentSettings,
) -> dict[RobotPair, str]:
    """Alignments that the estimate rests on, that no cycle confirms, and that a witness refutes: a sentence each.

    Args:
        shared: the estimate of all robots.
        alignments: of all pairs.
        links: of each pair.
        trajectories: of all robots.
        settings: of the alignment.
    """
    team = nx.Graph([(used.robot_a, used.robot_b) for used in shared.links])
    alone = {frozenset(pair) for pair in nx.bridges(team)}
    found: dict[RobotPair, str] = {}
    for pair, alignment in alignments.items():
        if pair not in shared.estimates or team.has_edge(*pair):
            continue
        way = [frozenset(step) for step in pairwise(nx.shortest_path(team, *pair)) if frozenset(step) in alone]
        if not way:
            continue
        log_odds = _against(shared.estimates[pair], alignment, links[pair], trajectories, settings)
        if log_odds > LIKELIER:
            sentence = (
                f"what {pair[0]} and {pair[1]} measured of each other contradicts how they lie by other robots"
                f" (10^{log_odds / np.log(10):.0f} to 1): one of them may have slipped, or been moved"
            )
            found |= {used: sentence for used in alignments if frozenset(used) in way}
    return found


def _against(
    estimate: SharedEstimate,
    alignment: FrameAlignment,
    links: Links,
    trajectories: Mapping[str, Trajectory],
    settings: AlignmentSettings,
) -> float:
    """Natural logarithm of the odds by two robots' own measurements against what an estimate predicts.

    The worst of three places: where they first heard each other, in the middle, and at the end.
    """
    check = RadioConsistencyCheck.of(alignment, links, trajectories, settings, max_odds=float(np.exp(LIKELIER)))
    if check is None:
        return -np.inf
    order = np.argsort(links.stamp_a_ns, kind="stable")
    rows = order[[0, len(order) // 2, -1]]
    index_a, index_b = links.index_a[rows], links.index_b[rows]
    predicted = estimate.relative_poses(links.robot_a, index_a, links.robot_b, index_b)
    return float(check.log_odds(*predicted, index_a, index_b).max())
