"""What is said of the radio between two robots, and the log once that is corrected."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure.pipeline.mutual_check.map_check import Contradiction
from wiclosure.pipeline.mutual_check.odds import Verdict, Weighed
from wiclosure.pipeline.mutual_check.pair_check import PairCheck
from wiclosure.pipeline.mutual_check.rivals.sets import RivalSets
from wiclosure.pipeline.mutual_check.verdicts import (
    cleared,
    corrected,
    in_doubt,
    left_apart,
    out_of_time,
    sentences,
    settled,
)
from wiclosure.types import (
    Closure,
    FilterResult,
    FrameAlignment,
    Heading,
    KeyframeId,
    Measured,
    Stage,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.faults.corrections import ranges_off, swapped

S, PAIR = 10**9, ("a", "b")
LOG = WirelessLog(
    (
        WirelessMeasurement(1 * S, "a", "b", 10.0, 0.1),
        WirelessMeasurement(2 * S, "c", "a", 20.0, 0.1),
        WirelessMeasurement(3 * S, "b", "a", 30.0, 0.1),
    ),
    (Heading(0, "a", 0.5, 0.1),),
)
TOO_LONG = Contradiction(20.0, (ranges_off(3.0),))
PATHS = {name: Trajectory(name, np.array([0, 100 * S]), np.tile(np.eye(4), (2, 1, 1))) for name in "abc"}


def filtered(suspected_fault: str = "") -> FilterResult:
    alignment = FrameAlignment(*PAIR, None, None, True, "", suspected_fault=suspected_fault)
    return FilterResult("wiclosure", (), 0, alignments=(alignment,), diagnosis=("of the filter",))


def check(verdict: Verdict) -> PairCheck:
    return PairCheck(PAIR, Weighed(verdict, 10.0, "something else"), found="9 closures that agree")


def said(suspected_fault: str, checks: list[PairCheck], found: Contradiction, *, corrects: bool = False) -> list[str]:
    return list(sentences(filtered(suspected_fault), checks, {PAIR: found}, corrects=corrects).values())


def test_only_measurements_of_the_pair_are_corrected_and_stay_in_order_of_time() -> None:
    log, done = corrected(LOG, {PAIR: TOO_LONG})
    assert [m.range_m for m in log.measurements] == [7.0, 20.0, 27.0]
    assert log.headings == LOG.headings
    assert done == (f"a and b: corrected, as was asked for: {TOO_LONG.likely}",)


def test_names_are_put_right_and_what_no_known_error_explains_stays() -> None:
    log, done = corrected(
        LOG, {PAIR: Contradiction(9.0, (swapped({"a": "b", "b": "a"}),)), ("a", "c"): Contradiction(9.0)}
    )
    assert [(m.receiver, m.transmitter) for m in log.measurements] == [("b", "a"), ("c", "a"), ("a", "b")]
    assert len(done) == 1


@pytest.mark.parametrize("verdict", [Verdict.CLOSURES, Verdict.COMPATIBLE])
def test_the_cause_is_that_of_the_map_where_it_knows_one(verdict: Verdict) -> None:
    (one,) = said("", [check(verdict)], TOO_LONG)
    assert "ranges are 3.0 m too long" in one
    assert "something else" not in one
    assert "10^9 to 1" in one
    assert one.endswith("--accept-correction corrects the log")


def test_where_the_map_knows_none_the_closures_cause_stays() -> None:
    (one,) = said("", [check(Verdict.CLOSURES)], Contradiction(20.0))
    assert "most likely: something else" in one
    assert "--accept-correction" not in one


def test_a_cause_that_the_filter_named_is_not_repeated_but_another_is_said() -> None:
    assert said(f"{TOO_LONG.likely} (--accept-correction applies it)", [], TOO_LONG) == []
    (one,) = said("azimuths seem to be reversed", [], TOO_LONG)
    assert one == f"a and b: {TOO_LONG}; --accept-correction corrects the log"
    assert said("", [], TOO_LONG, corrects=True) == [f"a and b: {TOO_LONG}"]


def test_a_log_an_hour_away_names_the_time_zone_and_how_to_put_it_right() -> None:
    assert out_of_time(LOG, PATHS) == ()
    assert out_of_time(WirelessLog(), PATHS) == ()
    late = [replace(m, stamp_ns=m.stamp_ns + 3600 * S) for m in LOG.measurements]
    (one,) = out_of_time(WirelessLog(tuple(late)), PATHS)
    assert "a time zone" in one
    assert "add time_offset: -3600" in one


def test_what_the_filter_suspects_is_taken_back_where_the_log_fits_the_map() -> None:
    doubts = [
        FrameAlignment(
            *pair, None, None, True, "odometry seems to slip at 4 s", suspected_fault="odometry seems to slip"
        )
        for pair in (PAIR, ("a", "c"))
    ]
    told = tuple(f"{d.robot_a} and {d.robot_b}: {d.reason}; every pair is kept" for d in doubts)
    result = FilterResult("wiclosure", (), 0, alignments=tuple(doubts), diagnosis=(*told, "of something else"))
    after = cleared(result, {PAIR, ("b", "c")})
    assert [one.suspected_fault for one in after.alignments] == ["", "odometry seems to slip"]
    assert after.alignments[0].ambiguous
    assert after.diagnosis[0].startswith("a and b: before robots were merged")
    assert after.diagnosis[0].endswith("nothing seems to be wrong with them; every pair is kept")
    assert after.diagnosis[1:] == (told[1], "of something else")


def undecided() -> PairCheck:
    return PairCheck(PAIR, Weighed(Verdict.UNDECIDED, 1.0, "ranges in feet"), found="9 closures that agree")


def test_where_nothing_decides_the_robots_go_on_without_radio_and_the_map_is_in_doubt() -> None:
    check = undecided()
    assert check.drops_radio
    (one,) = said("", [check], TOO_LONG)
    assert "nothing decides (3 to 1)" in one
    nameless = replace(undecided(), weighed=Weighed(Verdict.UNDECIDED, 1.0, ""))
    assert "the radio may be at fault, for no known reason, or the places look alike" in nameless.sentence
    assert in_doubt([check], [accepted("b", "a")]) == {PAIR}
    assert in_doubt([check], [accepted("a", "c")]) == set()
    assert in_doubt([replace(check, weighed=Weighed(Verdict.CLOSURES, 9.0, ""))], [accepted("b", "a")]) == set()


def test_a_set_that_only_the_rarity_of_an_error_speaks_for_puts_the_map_in_doubt() -> None:
    rivals = RivalSets(PAIR, frozenset(range(9)), frozenset({10, 11}), 8.0, contested="ranges seem to be in feet")
    assert in_doubt([rivals], [accepted("b", "a")]) == {PAIR}
    assert "the map may be wrong" in rivals.sentence
    assert in_doubt([replace(rivals, contested="")], [accepted("b", "a")]) == set()


def accepted(query: str, match: str) -> Closure:
    closure = Closure.from_measurement(KeyframeId(query, 0), KeyframeId(match, 0), np.eye(4), np.eye(6))
    return closure.accepted(Stage.ESTIMATE)


def test_what_was_undecided_is_settled_by_rival_sets_or_by_a_log_that_fits_the_map() -> None:
    rivals = RivalSets(PAIR, frozenset(range(9)), frozenset({10, 11}), 8.0, "ranges seem to be in feet")
    open_still = replace(rivals, lost=frozenset())
    (by_rivals,) = settled([undecided()], [rivals], set())
    assert by_rivals.weighed == Weighed(Verdict.CLOSURES, 8.0, "ranges seem to be in feet")
    (by_map,) = settled([undecided()], [open_still], {PAIR})
    assert by_map.weighed is not None
    assert by_map.weighed.verdict is Verdict.COMPATIBLE
    assert settled([undecided()], [open_still], {("a", "c")})[0].undecided
    decided = check(Verdict.RADIO)
    assert settled([decided], [rivals], {PAIR}) == (decided,)


def between(robots: tuple[str, str], *, accepted: bool) -> Closure:
    ends = KeyframeId(robots[0], 0), KeyframeId(robots[1], 1)
    closure = Closure(*ends, passed=Stage.REGISTRATION, measured=Measured(np.eye(4), np.eye(6)))
    return closure.accepted(Stage.CONSISTENCY) if accepted else closure.rejected(Stage.CONSISTENCY, "ambiguous")


@pytest.mark.parametrize(
    ("lost", "joined", "apart"),
    [(frozenset(), False, True), (frozenset({9}), False, False), (frozenset(), True, False)],
)
def test_robots_that_undecided_sets_leave_apart_go_on_without_radio(
    lost: frozenset[int], joined: bool, apart: bool
) -> None:
    sets = RivalSets(PAIR, frozenset(range(5)), lost, 1.9)
    closures = [between(PAIR, accepted=joined), between(("a", "c"), accepted=True)]
    found = left_apart([sets], closures)
    assert [one.pair for one in found] == ([PAIR] if apart else [])
    for one in found:
        assert one.drops_radio
        assert one.sentence == f"{sets.sentence}; its measurements between these robots are left out"
        assert in_doubt([one], [between(PAIR, accepted=True)]) == {PAIR}
        assert in_doubt([one], []) == set()
