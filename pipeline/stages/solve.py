"""From odometry and radio to one estimate: the part of a run that a candidate filter changes."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure.backends.pcm import pairwise_consistent
from wiclosure.backends.pose_graph import GraphResult, optimise
from wiclosure.frontends.front_end import FrontEndResult, describe_shifted
from wiclosure.frontends.intra_robot_loops import intra_robot_loops
from wiclosure.frontends.matching import MatchResult, match
from wiclosure.interfaces import CandidateFilter
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.runtime.stopwatch import Stopwatch
from wiclosure.pipeline.stages.radio_check import radio_checked
from wiclosure.pipeline.stages.registrations import RegistrationPool
from wiclosure.types import CandidatePairs, Closure, FilterResult, KeyframeId, Stage, WirelessLog, survivors

logger = logging.getLogger(__name__)

_FIGURES = re.compile(r"-?\d[\d.,^]*")
BYTES_PER_POSE = 64  # stamp, position and quaternion, 8 bytes each


@dataclass(frozen=True, eq=False)
class Solution:
    """What one filter made of the robots' odometry.

    Args:
        filtered: pairs kept by the filter, alignments, its diagnosis.
        matched: what scan context proposed of them, one entry per robot pair.
        closures: every proposed closure with its final decision and reason; how many survived a stage is a count.
        graph: trajectories in one world frame.
        seconds: time per stage, as if nothing had been computed before; of registrations side by side, their sum.
        seconds_spent: wall time really spent, registrations that other arms had done left out.
        bytes_exchanged: what the robots would have sent each other.
        diagnosis: sentences for the user: why there are few or no closures.
    """

    filtered: FilterResult
    matched: tuple[MatchResult, ...]
    closures: tuple[Closure, ...]
    graph: GraphResult
    seconds: dict[str, float]
    seconds_spent: dict[str, float]
    bytes_exchanged: int
    diagnosis: tuple[str, ...]


def solve(
    fronts: Mapping[str, FrontEndResult],
    wireless: WirelessLog,
    candidate_filter: CandidateFilter,
    config: Config,
    *,
    registrations: RegistrationPool,
    progress: Progress,
) -> Solution:
    """Filter, match, register, check by radio, check consistency, optimise."""
    keyframes = {robot: front.keyframes for robot, front in fronts.items()}

    filtered = candidate_filter.candidates(keyframes, wireless)
    own = [intra_robot_loops(k, config.revisits) for k in keyframes.values()] if config.revisits.enabled else []
    candidates = (*filtered.pairs, *own)
    took = Stopwatch()
    with took.time("matching"):
        matched = _match(candidates, fronts, config)
    proposed = [closure for result in matched for closure in result.closures]
    with took.time("verification"):
        registered, uncached_registration_s = registrations.register(proposed, progress)
    with took.time("check"):
        checked = radio_checked(registered, filtered.checks)
    with took.time("optimisation"):
        consistent = pairwise_consistent(checked, keyframes, config.pcm)
        graph = optimise(keyframes, consistent.closures, config.pose_graph.scaled(consistent.scale), filtered.links)

    seconds = {
        "filter": filtered.seconds + took["check"],
        "matching": took["matching"],
        "verification": uncached_registration_s,
        "optimisation": took["optimisation"],
    }
    return Solution(
        filtered=filtered,
        matched=matched,
        closures=graph.closures,
        graph=graph,
        seconds=seconds,
        seconds_spent=seconds | {"verification": took["verification"]},
        bytes_exchanged=_bytes_exchanged(filtered, graph.closures, fronts),
        diagnosis=(
            *filtered.diagnosis,
            *_nothing_left(filtered, matched, graph.closures),
            *consistent.diagnosis,
            *graph.diagnosis,
        ),
    )


def _match(
    candidates: Sequence[CandidatePairs], fronts: Mapping[str, FrontEndResult], config: Config
) -> tuple[MatchResult, ...]:
    """Proposes the candidates that look alike."""
    shifted = {
        robot: describe_shifted(front.clouds, config.scan_context, config.matching.lateral_shift_m)
        for robot, front in fronts.items()
    }
    return tuple(
        match(
            pairs,
            fronts[pairs.robot_a].descriptors,
            fronts[pairs.robot_b].descriptors,
            config.matching,
            shifted[pairs.robot_a],
        )
        for pairs in candidates
    )


def _bytes_exchanged(filtered: FilterResult, closures: Sequence[Closure], fronts: Mapping[str, FrontEndResult]) -> int:
    """What crosses the radio link: robot_b of each pair sends, robot_a compares.

    A filter that predicts needs the keyframe trajectory first; then go descriptors of the keyframes that occur in kept
    pairs, then clouds of those in proposed closures, each once.
    """
    predicted = {pairs.robot_b for pairs in filtered.pairs if pairs.predicts is not None}
    trajectories = sum(len(fronts[b].keyframes) * BYTES_PER_POSE for b in predicted)
    described = {(p.robot_a, p.robot_b): np.unique(p.index_b) for p in filtered.pairs}
    descriptors = sum(len(index) * fronts[b].descriptors[0].nbytes for (_, b), index in described.items())
    sent: set[tuple[str, KeyframeId]] = {(c.query.robot, c.match) for c in closures if c.query.robot != c.match.robot}
    return trajectories + int(descriptors) + sum(fronts[key.robot].clouds[key.index].nbytes for _, key in sent)


def _nothing_left(
    filtered: FilterResult, matched: Sequence[MatchResult], closures: Sequence[Closure]
) -> tuple[str, ...]:
    """Where the candidates were lost, said when nothing reached the graph."""
    registered, checked, estimated = (
        len(survivors(closures, stage)) for stage in (Stage.REGISTRATION, Stage.RADIO_CHECK, Stage.ESTIMATE)
    )
    if estimated or not filtered.pairs:
        return ()
    reasons = [closure.reason for closure in closures if closure.rejected_at is not None]
    kinds = Counter(_FIGURES.sub("", reason) for reason in reasons)
    usual = next((r for r in reasons if _FIGURES.sub("", r) == kinds.most_common(1)[0][0]), "")
    often = f"; for example: {usual}" if usual else ""
    return (
        f"no closure was accepted: of {filtered.pairs_total} pairs the filter kept {filtered.pairs_kept}, scan context"
        f" compared {sum(m.pairs_compared for m in matched)} and proposed {len(closures)}, registration accepted"
        f" {registered}, of which the radio check left {checked}{often}",
    )
