"""What to do next when a run went wrong: by where its closures were lost, and what the radio could not tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import product

from wiclosure.pipeline.report.html.closures_data import reason_kind
from wiclosure.pipeline.report.html.verdict import counted_noun
from wiclosure.pipeline.stages.run_result import RunResult, Solution
from wiclosure.types import Closure, FrameAlignment, Stage
from wiclosure.wiclosure_filter.alignment.indistinguishable import MOVED_ALIKE

MOST_STEPS = 6
_WHERE = {
    Stage.MATCHING: "matching",
    Stage.REGISTRATION: "registration",
    Stage.RADIO_CHECK: "the radio check",
    Stage.CONSISTENCY: "the consistency check",
    Stage.ESTIMATE: "the estimate",
}


def next_steps(result: RunResult) -> list[str]:
    """Sentences, the most pressing first; empty where nothing is wrong."""
    steps = [*_false_closures(result), *_doubts(result), *_connections(result)]
    steps += [*_contradictions(result), *_radio(result)]
    rest = len(steps) - MOST_STEPS
    return steps[:MOST_STEPS] + ([f"{rest} more pairs of robots have like troubles; see below."] if rest > 0 else [])


def _false_closures(result: RunResult) -> list[str]:
    false = result.metrics["closures"]["accepted_false"]
    if not false:
        return []
    cliques, inliers = result.config.pcm.min_clique_size, result.config.registration.min_inlier_ratio
    stricter = (
        f"A stricter consistency check refuses more: raise pcm.min_clique_size (now {cliques}) or"
        f" registration.min_inlier_ratio (now {inliers:g})."
    )
    if result.solution.doubts:
        stricter = "They agree with each other, as those of look-alike places do: a stricter check would keep them."
    are = "1 accepted closure is" if false == 1 else f"{false} accepted closures are"
    return [f"{are} false by ground truth: look at both scans under Closures. {stricter}"]


def doubts(solution: Solution) -> list[str]:
    """What the first sentence of a page must not keep to itself, as clauses."""
    said = ["the map may be wrong, since another one fits about as well"] if solution.doubts else []
    return said + (["the radio log seems wrong, or contradicts the closures"] if solution.contradictions else [])


def _doubts(result: RunResult) -> list[str]:
    unused = result.metrics["filter"] == "none"
    radio = "let the radio decide (--filter wiclosure)" if unused else "measure more by radio between them"
    remedies = {
        jump.doubt: f"Look at the odometry of {jump.robot} there (Before, under the merged map): if the robot was"
        " carried or slipped, cut the recording in two there; if not, look at the closures on both sides under Closures"
        for jump in result.solution.open_jumps
    }
    places = (
        f"Compare both scans of closures under Closures; let the robots share places that look different, or {radio}"
    )
    return [f"{doubt}. {remedies.get(doubt, places)}." for doubt in result.solution.doubts]


def _contradictions(result: RunResult) -> list[str]:
    return [
        f"{said}. wiclosure radio check LOG -t NAME=FILE says which key of the data set puts a log right."
        for said in result.solution.contradictions
    ]


def _connections(result: RunResult) -> list[str]:
    """One sentence for each group of robots that nothing joins to the first."""
    first, *others = result.solution.graph.components
    steps = []
    for group in others:
        pairs = [
            p
            for a, b in product(first, group)
            for p in result.solution.filtered.pairs
            if {p.robot_a, p.robot_b} == {a, b}
        ]
        if not pairs:
            steps.append(f"{' and '.join(group)}: no pairs of keyframes with {', '.join(first)} were looked at.")
            continue
        between = {id(p): _between(result.solution.closures, p.robot_a, p.robot_b) for p in pairs}
        best = max(pairs, key=lambda p: (_furthest(between[id(p)]), len(between[id(p)]), len(p)))
        lost = _lost(result, len(best), between[id(best)])
        steps.append(f"{best.robot_a} and {best.robot_b} are not connected: {lost}")
    return steps


def _between(closures: Sequence[Closure], a: str, b: str) -> list[Closure]:
    return [c for c in closures if {c.query.robot, c.match.robot} == {a, b}]


def _furthest(closures: Sequence[Closure]) -> int:
    return max((int(c.rejected_at or Stage.ESTIMATE) for c in closures), default=0)


def _lost(result: RunResult, kept: int, closures: Sequence[Closure]) -> str:
    """Where two robots' closures were lost, and the remedy."""
    config, name = result.config, result.solution.filtered.filter_name
    if not kept:
        return (
            f"the filter {name} kept none of their pairs of keyframes, as if their paths never came near each other. If"
            " they did, look at the radio below for a wrong time offset, antenna axis or unit, and try --filter none."
        )
    if not closures:
        return (
            f"none of {kept:,} kept pairs looks alike. Let the robots pass the same places, in any direction, or raise"
            f" matching.max_distance (now {config.matching.max_distance:g})."
        )
    stage, count = Counter(c.rejected_at for c in closures if c.rejected_at is not None).most_common(1)[0]
    reasons = [c.reason for c in closures if c.rejected_at is stage]
    usual = Counter(map(reason_kind, reasons)).most_common(1)[0][0]
    example = next(reason for reason in reasons if reason_kind(reason) == usual)
    number = counted_noun(len(closures), "closure")
    lost = f"{count} of {number} were rejected at {_WHERE[stage]}, mostly like this: {example}."
    return f"{lost} {_remedy(result, stage)}"


def _remedy(result: RunResult, stage: Stage) -> str:
    registration = result.config.registration
    match stage:
        case Stage.REGISTRATION:
            return (
                "Open some of them under Closures: where both scans fit, lower registration.min_inlier_ratio"
                f" (now {registration.min_inlier_ratio:g}) or registration.min_agreement (now"
                f" {registration.min_agreement:g}); where they do not, the robots saw no common place."
            )
        case Stage.RADIO_CHECK:
            return (
                "Radio and scans contradict each other: check the log's time offset, antenna axes and units."
                " filter.closure_odds=null leaves this check out."
            )
        case Stage.CONSISTENCY:
            return (
                "Too few closures agree to tell true from false: let the robots share more of their paths, or propose"
                " more closures (matching.candidates_per_keyframe, matching.suppression)."
            )
        case _:
            return "The odometry may drift more than the settings under drift say."


def _radio(result: RunResult) -> list[str]:
    if result.solution.filtered.filter_name != "wiclosure" or len(result.fronts) < 2:
        return []
    if not result.inputs.wireless.measurements:
        return [
            "There is no radio measurement, so the filter kept every pair: name a log with --wireless, or under"
            " wireless in the data set file."
        ]
    return ambiguities(result.solution.filtered.alignments)


def ambiguities(alignments: Sequence[FrameAlignment]) -> list[str]:
    """What is wrong with the radio, and what would make each alignment certain that is not."""
    return [_fault(a) if a.suspected_fault else _ambiguous(a) for a in alignments if a.ambiguous]


def _fault(alignment: FrameAlignment) -> str:
    if alignment.suspected_fault.startswith(MOVED_ALIKE):
        return (
            f"Nothing is known to be wrong with the radio of {alignment.robot_a} and {alignment.robot_b}, but"
            f" {alignment.suspected_fault.rstrip('.')}. Let one of them drive a loop or a turn while they hear each"
            " other, or a third robot join; where you know that the log is right: --set"
            " filter.alignment.guard.weigh_blunders=false."
        )
    return (
        f"Radio or odometry of {alignment.robot_a} and {alignment.robot_b} seems wrong, so nothing is pruned by it:"
        f" {alignment.suspected_fault.rstrip('.')}. wiclosure radio check LOG -t NAME=FILE holds the log against the"
        " trajectories, and says which key of the data set corrects it; look at the residuals over time below."
    )


def _ambiguous(alignment: FrameAlignment) -> str:
    more = (
        "angles of arrival besides ranges"
        if alignment.heading_knowledge in {"range-only", "none"}
        else "a compass heading, or angles measured by both robots"
    )
    return (
        f"The radio does not tell how {alignment.robot_a} and {alignment.robot_b} lie: {alignment.reason}. Let both"
        f" drive on while they hear each other, not on parallel straight lines, or add {more}."
    )
