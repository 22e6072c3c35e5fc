"""What a run says of the radio, once for each two robots, and the log with what is wrong with it undone."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

from wiclosure.pipeline.mutual_check.map_check import Contradiction
from wiclosure.pipeline.mutual_check.odds import Verdict, Weighed
from wiclosure.pipeline.mutual_check.pair_check import Pair, PairCheck, agreeing
from wiclosure.pipeline.mutual_check.rivals.sets import RivalSets
from wiclosure.pipeline.radio.check.clock import Span, check_overlap, common_span
from wiclosure.types import Closure, FilterResult, Stage, Trajectory, WirelessLog, survivors
from wiclosure.wiclosure_filter.faults.diagnosis import between

_CLEARED = (
    "before robots were merged, the measurements left their alignment in doubt; they fit where the merged map has the"
    " robots, and nothing seems to be wrong with them"
)


def sentences(
    filtered: FilterResult,
    checks: Sequence[PairCheck],
    by_map: Mapping[Pair, Contradiction],
    *,
    corrects: bool,
) -> dict[Pair, str]:
    """What closures and merged map tell of the radio, and the filter does not: one sentence for each two robots.

    Args:
        filtered: of the filter.
        checks: pairs of robots of which radio and closures told differently.
        by_map: measurements that the merged map contradicts.
        corrects: whether what is named is corrected; otherwise it is said how that is done.
    """
    checked = {one.pair: one for one in checks if one.sentence}
    named = {(one.robot_a, one.robot_b): one.suspected_fault for one in filtered.alignments}
    of_closures = {pair: one.said(by_map.get(pair)) for pair, one in checked.items()}
    of_map = {
        pair: f"{pair[0]} and {pair[1]}: {found}"
        for pair, found in by_map.items()
        if pair not in checked and not _is_named(named.get(pair, ""), found)
    }
    return {pair: _with_remedy(one, by_map.get(pair), corrects) for pair, one in (of_closures | of_map).items()}


def settled(
    checks: Sequence[PairCheck], rivals: Sequence[RivalSets], fitting: Collection[Pair]
) -> tuple[PairCheck, ...]:
    """Checks that decided nothing, decided by what was found without the radio.

    Args:
        checks: pairs of robots of which radio and closures told differently.
        rivals: sets of closures that contradict each other, and what the radio told of them.
        fitting: robots whose log fits the merged map.
    """
    told = {one.pair: one for one in rivals if one.decides}

    def as_settled(check: PairCheck) -> PairCheck:
        if not check.undecided or check.weighed is None:
            return check
        if (rival := told.get(check.pair)) is not None:
            verdict = Verdict.CLOSURES if rival.cause else Verdict.COMPATIBLE
            found = agreeing(len(rival.kept))
            return replace(check, weighed=Weighed(verdict, rival.log_odds, rival.cause), found=found)
        if check.pair in fitting:
            return replace(check, weighed=replace(check.weighed, verdict=Verdict.COMPATIBLE))
        return check

    return tuple(map(as_settled, checks))


def left_apart(rivals: Sequence[RivalSets], closures: Sequence[Closure]) -> list[PairCheck]:
    """Robots that no accepted closure joins since sets that contradict each other are alike: they go on without radio.

    What the radio refused of the sets may be what makes them alike; without it the map is no worse than without one.

    Args:
        rivals: sets of closures, and what the radio told of them.
        closures: as the consistency check left them.
    """
    joined = _joined(survivors(closures, Stage.CONSISTENCY))
    apart = [one for one in rivals if not one.decides and frozenset(one.pair) not in joined]
    remedy = "its measurements between these robots are left out"
    return [PairCheck(one.pair, contested=f"{one.sentence}; {remedy}", alone=True) for one in apart]


def in_doubt(told: Sequence[PairCheck] | Sequence[RivalSets], accepted: Sequence[Closure]) -> set[Pair]:
    """Of the robots that something doubtful was told of, those that accepted closures join: the map rests on it."""
    joined = _joined(accepted)
    return {one.pair for one in told if one.doubts and frozenset(one.pair) in joined}


def _joined(closures: Iterable[Closure]) -> set[frozenset[str]]:
    """Robots that closures join."""
    return {frozenset((c.query.robot, c.match.robot)) for c in closures}


def cleared(filtered: FilterResult, fitting: Collection[Pair]) -> FilterResult:
    """Without faults that the filter suspects by the log alone, of robots whose log fits the merged map."""
    was = {(one.robot_a, one.robot_b): one for one in filtered.alignments if one.suspected_fault}
    now = {pair: replace(was[pair], suspected_fault="", reason=_CLEARED) for pair in was.keys() & set(fitting)}
    said = {f"{a} and {b}: {was[a, b].reason}": f"{a} and {b}: {_CLEARED}" for a, b in now}

    def restated(sentence: str) -> str:
        before = next((text for text in said if sentence.startswith(text)), None)
        return sentence if before is None else said[before] + sentence[len(before) :]

    return replace(
        filtered,
        alignments=tuple(now.get((one.robot_a, one.robot_b), one) for one in filtered.alignments),
        diagnosis=tuple(map(restated, filtered.diagnosis)),
    )


def out_of_time(wireless: WirelessLog, trajectories: Mapping[str, Trajectory]) -> tuple[str, ...]:
    """A sentence where the log shares no time with the robots, with what may explain it."""
    stamps = [m.stamp_ns for m in wireless.measurements]
    apart = check_overlap(Span(min(stamps), max(stamps)), common_span(trajectories)) if stamps else None
    if apart is None:
        return ()
    advice = f" ({apart.advice} to the log in dataset.yaml)" if apart.advice else ""
    return (f"the radio is not used, its clock is the likely fault: {apart.text}{advice}",)


def corrected(wireless: WirelessLog, by_map: Mapping[Pair, Contradiction]) -> tuple[WirelessLog, tuple[str, ...]]:
    """The log with the likeliest cause of each contradiction undone, and what was done."""
    undone = {pair: found.causes[0] for pair, found in by_map.items() if found.causes}
    parts = between(wireless, set(undone))
    ends = {frozenset(pair) for pair in undone}
    left = tuple(m for m in wireless.measurements if frozenset((m.receiver, m.transmitter)) not in ends)
    log = WirelessLog(left, wireless.headings)
    for pair, cause in undone.items():
        log += WirelessLog(cause.apply(({}, parts[pair]))[1].measurements)
    return log, tuple(f"{a} and {b}: corrected, as was asked for: {cause.fault}" for (a, b), cause in undone.items())


def _is_named(suspected_fault: str, found: Contradiction) -> bool:
    """Whether the filter named one of the causes."""
    return any(suspected_fault.startswith(cause.fault) for cause in found.causes)


def _with_remedy(sentence: str, found: Contradiction | None, corrects: bool) -> str:
    known = found is not None and found.causes
    return f"{sentence}; --accept-correction corrects the log" if known and not corrects else sentence
