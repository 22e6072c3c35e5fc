from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wiclosure.backends.odometry_jump import OdometryJump
from wiclosure.pipeline.report.html.advice import doubts, next_steps
from wiclosure.pipeline.report.html.verdict import run_verdict
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import CandidatePairs, Stage, WirelessLog
from wiclosure.wiclosure_filter.alignment.indistinguishable import MOVED_ALIKE

Runs = Callable[..., RunResult]


def without(result: RunResult, **solution: object) -> RunResult:
    return replace(result, solution=replace(result.solution, **solution))


def filtered(result: RunResult, **changes: object) -> RunResult:
    return without(result, filtered=replace(result.solution.filtered, **changes))


def test_nothing_wrong_needs_nothing_done(run_of: Runs) -> None:
    assert next_steps(run_of()) == []


def test_why_robots_are_not_connected_and_that_the_radio_is_ambiguous(lost_run: RunResult) -> None:
    connection, radio = next_steps(lost_run)
    assert connection.startswith("beta and gamma are not connected: 1 of 4 closures were rejected at registration")
    assert radio.startswith("The radio does not tell how beta and gamma lie: an alignment 5.0 m away")


@pytest.mark.parametrize(
    ("stage", "words"),
    [
        (Stage.REGISTRATION, "registration.min_inlier_ratio (now 0.4)"),
        (Stage.RADIO_CHECK, "time offset, antenna axes and units"),
        (Stage.CONSISTENCY, "share more of their paths"),
        (Stage.ESTIMATE, "settings under drift"),
    ],
)
def test_the_remedy_fits_the_stage_that_lost_most(lost_run: RunResult, stage: Stage, words: str) -> None:
    lost = tuple(c for c in lost_run.solution.closures if c.rejected_at is stage)
    assert words in next_steps(without(lost_run, closures=lost))[0]


def test_no_closures_and_no_pairs(lost_run: RunResult) -> None:
    silent = filtered(lost_run, alignments=())
    assert "looks alike" in next_steps(without(silent, closures=()))[0]
    none = np.zeros(0, np.int64)
    pairs = tuple(
        CandidatePairs.without_prediction(p.robot_a, p.robot_b, none, none) for p in silent.solution.filtered.pairs
    )
    assert "kept none of their pairs" in next_steps(without(filtered(silent, pairs=pairs), closures=()))[0]
    assert next_steps(without(filtered(silent, pairs=()), closures=())) == [
        "gamma: no pairs of keyframes with alpha, beta were looked at."
    ]


def test_false_closures_come_first(lost_run: RunResult) -> None:
    closures = lost_run.metrics["closures"] | {"accepted_false": 2}
    assert next_steps(replace(lost_run, metrics=lost_run.metrics | {"closures": closures}))[0].startswith(
        "2 accepted closures are false"
    )


def test_no_stricter_check_is_advised_against_false_closures_that_agree(lost_run: RunResult) -> None:
    false = replace(
        lost_run, metrics=lost_run.metrics | {"closures": lost_run.metrics["closures"] | {"accepted_false": 1}}
    )
    assert "raise pcm.min_clique_size" in next_steps(false)[0]
    said = next_steps(without(false, doubts=("alpha and beta: the map may be wrong",)))
    assert said[0].startswith("1 accepted closure is false by ground truth")
    assert "min_clique_size" not in said[0]


def test_a_doubt_of_odometry_is_to_be_looked_at_in_the_odometry(run_of: Runs) -> None:
    jump = OdometryJump("beta", 7, np.array([0, 0, 0.5, 3.0, 0, 0]))
    (said,) = next_steps(without(run_of(), doubts=(jump.doubt,), open_jumps=(jump,)))
    assert said.startswith(f"{jump.doubt}. Look at the odometry of beta there")
    assert "radio" not in said


def test_a_fault_of_the_radio_is_named_with_the_way_out(lost_run: RunResult) -> None:
    sound, unsure = lost_run.solution.filtered.alignments
    faulty = replace(unsure, suspected_fault="all azimuths are mirrored")
    said = next_steps(filtered(lost_run, alignments=(sound, faulty)))[-1]
    assert said.startswith("Radio or odometry of beta and gamma seems wrong")
    assert "all azimuths are mirrored. wiclosure radio check" in said


def test_robots_that_moved_alike_are_no_fault(lost_run: RunResult) -> None:
    sound, unsure = lost_run.solution.filtered.alignments
    alike = replace(unsure, suspected_fault=f"{MOVED_ALIKE} azimuths were clockwise (27 m). Odds 13 to 1")
    said = next_steps(filtered(lost_run, alignments=(sound, alike)))[-1]
    assert said.startswith(f"Nothing is known to be wrong with the radio of beta and gamma, but {MOVED_ALIKE}")
    assert "seems wrong" not in said
    assert "a third robot" in said


def test_a_log_without_measurements(run_of: Runs) -> None:
    made = run_of()
    silent = replace(made, inputs=replace(made.inputs, wireless=WirelessLog()))
    assert next_steps(silent)[0].startswith("There is no radio measurement")
    assert next_steps(filtered(silent, filter_name="none", alignments=())) == []


def test_sets_that_contradict_each_other_and_a_wrong_log_are_said_first(run_of: Runs) -> None:
    result = without(
        run_of(), contradictions=("alpha and beta: feet",), doubts=("alpha and beta: the map may be wrong",)
    )
    first, second = next_steps(result)[:2]
    assert first.startswith("alpha and beta: the map may be wrong. Compare both scans")
    assert first.endswith("or measure more by radio between them.")
    unfiltered = replace(result, metrics=result.metrics | {"filter": "none"})
    assert next_steps(unfiltered)[0].endswith("or let the radio decide (--filter wiclosure).")
    assert second.startswith("alpha and beta: feet. wiclosure radio check")
    verdict = run_verdict(result.metrics, next_steps(result), doubts(result.solution))
    assert verdict["tone"] == "warn"
    assert "; the map may be wrong, since" in verdict["sentence"]
    assert "; the radio log seems wrong, or contradicts the closures" in verdict["sentence"]
