"""From odometry and radio to one estimate: the part of a run that a candidate filter changes."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.backends.consistency.pcm import PcmResult, pairwise_consistent
from wiclosure.backends.estimate.graph_result import GraphResult, propagate_to_scans
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.interfaces import CandidateFilter
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.map_check import AgainstMap, held_against_map
from wiclosure.pipeline.mutual_check.pair_check import Pair, PairCheck, ends
from wiclosure.pipeline.mutual_check.rivals.maps import RivalMap, rival_maps
from wiclosure.pipeline.mutual_check.rivals.sets import RivalSets, weigh_rivals, without_lost
from wiclosure.pipeline.mutual_check.verdicts import (
    cleared,
    corrected,
    in_doubt,
    left_apart,
    out_of_time,
    sentences,
    settled,
)
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.runtime.stopwatch import Stopwatch
from wiclosure.pipeline.stages.attempts import Attempt, Attempts
from wiclosure.pipeline.stages.registrations import RegistrationPool
from wiclosure.pipeline.stages.run_result import Solution, nothing_left, nothing_to_merge, own_loops
from wiclosure.pipeline.stages.viewer import Viewer
from wiclosure.types import Closure, EarthMeasurements, FilterResult, KeyframeId, WirelessLog

logger = logging.getLogger(__name__)

BYTES_PER_POSE = 64  # stamp, position and quaternion, 8 bytes each


def solve(
    fronts: Mapping[str, FrontEndResult],
    wireless: WirelessLog,
    candidate_filter: CandidateFilter,
    config: Config,
    *,
    registrations: RegistrationPool,
    progress: Progress,
    viewer: Viewer,
    earth: EarthMeasurements | None = None,
) -> Solution:
    """Filter, match, register, check radio and closures against each other, check consistency, optimise."""
    keyframes = {robot: front.keyframes for robot, front in fronts.items()}
    attempts = Attempts(fronts, keyframes, candidate_filter, config, registrations, progress, viewer)
    took, corrects, corrections = Stopwatch(), config.filter.accept_correction, tuple[str, ...]()
    found = _estimated(attempts, wireless, earth, took)
    if corrects and any(contradiction.causes for contradiction in found.by_map.contradicted.values()):
        log, corrections = corrected(wireless, found.by_map.contradicted)
        found = _estimated(attempts, log, earth, took)
    else:
        found = _widened(attempts, found, wireless, earth, took)

    agreed = found.agreed
    filtered, closures = cleared(agreed.attempt.filtered, found.by_map.fitting), found.graph.closures
    checks = settled(agreed.checks, agreed.rivals, found.by_map.fitting)
    told = sentences(filtered, checks, found.by_map.contradicted, corrects=corrects)
    unsure = in_doubt(checks, found.graph.accepted)
    unsure_rivals = in_doubt(agreed.rivals, found.graph.accepted)
    doubts = _doubts(found, told, unsure, unsure_rivals)
    contradictions = (
        *(out_of_time(wireless, keyframes) if filtered.alignments else ()),
        *(said for pair, said in told.items() if pair not in unsure),
    )
    seconds = {**attempts.seconds, "optimisation": took["optimisation"]}
    seconds["filter"] += took["check"]
    return Solution(
        filtered=filtered,
        matched=agreed.attempt.matched,
        closures=closures,
        graph=found.graph,
        seconds=seconds,
        seconds_spent=seconds | {"verification": attempts.took["verification"]},
        bytes_exchanged=_bytes_exchanged(filtered, closures, fronts),
        contradictions=contradictions,
        doubts=doubts,
        open_jumps=agreed.consistent.open_jumps,
        without_radio=tuple(one.pair for one in checks if one.drops_radio),
        diagnosis=(
            *doubts,
            *contradictions,
            *corrections,
            *filtered.diagnosis,
            *(one.sentence for one in agreed.rivals if one.pair not in unsure_rivals),
            *nothing_left(filtered, agreed.attempt.matched, closures),
            *own_loops(closures),
            *nothing_to_merge(fronts, closures),
            *agreed.consistent.remarks,
            *found.graph.diagnosis,
        ),
    )


@dataclass(frozen=True, eq=False)
class _Agreement:
    """Closures that agree.

    Args:
        attempt: all closures, as filter, matching, registration and radio check left them.
        checks: pairs of robots of which radio and closures told differently.
        wireless: the log; None where nothing is held against it.
        consistent: closures that agree.
        rivals: sets of closures that contradict each other, and what the radio told of them.
    """

    attempt: Attempt
    checks: Sequence[PairCheck]
    wireless: WirelessLog | None
    consistent: PcmResult
    rivals: Sequence[RivalSets]


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Of one log.

    Args:
        agreed: the closures that it rests on.
        graph: the estimate.
        by_map: what the merged map tells of the measurements.
        other_maps: ways in which robots may lie to each other as well, that their scans allow.
    """

    agreed: _Agreement
    graph: GraphResult
    by_map: AgainstMap
    other_maps: Sequence[RivalMap]


def _doubts(found: _Estimate, told: Mapping[Pair, str], unsure: Set[Pair], unsure_rivals: Set[Pair]) -> tuple[str, ...]:
    """Why the map may be wrong; of other maps only where nothing else is said of the two robots.

    Args:
        found: the estimate.
        told: what closures and map tell of the radio.
        unsure: robots of which that puts the map in doubt.
        unsure_rivals: those of which sets of closures that contradict each other do.
    """
    said_already = unsure | unsure_rivals | found.agreed.consistent.in_doubt
    return (
        *found.agreed.consistent.doubts,
        *(said for pair, said in told.items() if pair in unsure),
        *(one.sentence for one in found.agreed.rivals if one.pair in unsure_rivals),
        *(one.sentence for one in found.other_maps if not {one.pair, one.pair[::-1]} & said_already),
    )


def _estimated(
    attempts: Attempts, wireless: WirelessLog, earth: EarthMeasurements | None, took: Stopwatch
) -> _Estimate:
    attempt, checks = attempts.settled(wireless)
    heard = attempts.config.mutual_check.enabled and bool(attempt.filtered.alignments or checks)
    agreed = _agreeing(attempts, attempt, checks, wireless if heard else None, took)
    if apart := left_apart(agreed.rivals, agreed.consistent.closures):
        attempt, checks = attempts.settled(wireless, [*(one for one in checks if one.drops_radio), *apart])
        agreed = _agreeing(attempts, attempt, checks, wireless, took)
    return _merged(attempts, agreed, earth, took)


def _widened(
    attempts: Attempts, found: _Estimate, wireless: WirelessLog, earth: EarthMeasurements | None, took: Stopwatch
) -> _Estimate:
    """With the pairs that a log had pruned which the map refutes; as it was where these would tell another map."""
    refuted = found.by_map.contradicted
    attempt = attempts.unpruned(found.agreed.attempt, refuted)
    if attempt is found.agreed.attempt:
        return found
    wider = _merged(attempts, _agreeing(attempts, attempt, found.agreed.checks, wireless, took), earth, took)
    before, after = (
        ends([c for c in one.graph.accepted if (c.query.robot, c.match.robot) in refuted]) for one in (found, wider)
    )
    return wider if 2 * len(before & after) >= len(before) else found


def _merged(attempts: Attempts, agreed: _Agreement, earth: EarthMeasurements | None, took: Stopwatch) -> _Estimate:
    """The estimate, and what it tells of the log where there is one."""
    config, consistent, wireless = attempts.config, agreed.consistent, agreed.wireless
    with took.time("optimisation"):
        settings = config.pose_graph.scaled(consistent.scale)
        odometry = consistent.restated(attempts.keyframes)
        graph = optimise(odometry, consistent.closures, settings, agreed.attempt.filtered.links, earth)
    with took.time("check"):
        by_map = AgainstMap() if wireless is None else _held_against_map(attempts.fronts, graph, wireless, config)
    with took.time("optimisation"):
        other_maps = _other_maps(attempts, agreed, graph) if config.mutual_check.enabled else []
    return _Estimate(agreed, graph, by_map, other_maps)


def _agreeing(
    attempts: Attempts,
    attempt: Attempt,
    checks: Sequence[PairCheck],
    wireless: WirelessLog | None,
    took: Stopwatch,
) -> _Agreement:
    """Closures that agree, and sets that contradict each other, of which the log decides where there is one."""
    config, keyframes = attempts.config, attempts.keyframes
    with took.time("optimisation"):
        consistent = pairwise_consistent(attempt.closures, keyframes, config.pcm)
    with took.time("check"):
        rivals = [] if wireless is None else weigh_rivals(consistent, keyframes, wireless, config)
    with took.time("optimisation"):
        if decided := [one for one in rivals if one.decides]:
            left, told = without_lost(attempt.closures, decided), {row for one in decided for row in one.kept}
            consistent = pairwise_consistent(left, keyframes, config.pcm, told)
    return _Agreement(attempt, checks, wireless, consistent, rivals)


def _other_maps(attempts: Attempts, agreed: _Agreement, graph: GraphResult) -> list[RivalMap]:
    """Ways in which robots may lie to each other as well; not looked for where radio or GNSS has told the way."""
    fixed = {robot for robot, fixes in graph.ground.earth.fixes.items() if len(fixes)}
    closures = [c for c in graph.closures if not {c.query.robot, c.match.robot} <= fixed]
    contradicted = {one.pair for one in agreed.checks if one.weighed is not None or one.contested}
    alignments = agreed.attempt.filtered.alignments
    certain = {(one.robot_a, one.robot_b) for one in alignments if not one.ambiguous} - contradicted

    def register(proposed: Sequence[Closure]) -> list[Closure]:
        return attempts.registrations.register(proposed, attempts.progress)[0]

    clouds = {robot: front.clouds for robot, front in attempts.fronts.items()}
    merged, odometry, config = graph.trajectories, attempts.keyframes, attempts.config
    log = WirelessLog() if agreed.wireless is None else agreed.wireless
    return rival_maps(merged, closures, clouds, odometry, log, certain, config, register)


def _held_against_map(
    fronts: Mapping[str, FrontEndResult], graph: GraphResult, wireless: WirelessLog, config: Config
) -> AgainstMap:
    """What each map tells of the measurements between its robots."""
    found = AgainstMap()
    for component in graph.components:
        paths = {robot: graph.trajectories[robot] for robot in component}
        merged = {
            robot: replace(path, finer=propagate_to_scans(fronts[robot].scans, fronts[robot].keyframes, path))
            for robot, path in paths.items()
        }
        if len(merged) > 1:
            settings = config.filter.alignment, config.mutual_check
            found |= held_against_map(merged, graph.closures, wireless, *settings)
    return found


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
