from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.types import (
    Closure,
    KeyframeId,
    Measured,
    Prediction,
    PredictionKind,
    ScanContextMatch,
    Stage,
    measured_poses,
    survivors,
)

AHEAD = se3.from_yaw(0.1, np.array([3.0, 0.0, 0.0]))
LATER = list(Stage)[2:]  # stages that decide on measured closures

PROPOSED = Closure(KeyframeId("alpha", 3), KeyframeId("beta", 4), scan_context=ScanContextMatch(0.2, 0.5))
MEASURED = Closure.from_measurement(PROPOSED.query, PROPOSED.match, AHEAD, np.eye(6))


def test_the_stages_are_in_the_order_of_a_closures_life() -> None:
    assert [str(stage) for stage in sorted(Stage)] == [
        "matching", "registration", "radio check", "consistency", "estimate",
    ]  # fmt: skip


def test_a_life_from_matching_to_the_map() -> None:
    assert (PROPOSED.passed, PROPOSED.live, PROPOSED.measured) == (Stage.MATCHING, False, None)
    measured = PROPOSED.measured_as(Measured(AHEAD, np.eye(6)))
    assert not measured.live  # whether registration accepts the pose is still open
    closure = measured.accepted(Stage.REGISTRATION, "the walls match")
    for stage in LATER:
        assert closure.live
        assert not closure.survived(stage)
        closure = closure.accepted(stage)
        assert closure.survived(stage)
    assert closure.reason == "the walls match"  # a stage without a reason of its own leaves the one before
    assert closure.scan_context == PROPOSED.scan_context
    assert (PROPOSED.passed, PROPOSED.reason) == (Stage.MATCHING, "")  # nothing changes in place


@given(rejected_at=st.sampled_from(Stage), asked=st.sampled_from(Stage))
def test_a_rejected_closure_survived_every_stage_before_and_none_after(rejected_at: Stage, asked: Stage) -> None:
    closure = (PROPOSED if rejected_at <= Stage.REGISTRATION else MEASURED).rejected(rejected_at, "no")
    assert closure.survived(asked) == (asked < rejected_at)
    assert not closure.live


@given(passed=st.sampled_from(Stage), stage=st.sampled_from(Stage))
def test_decisions_only_go_forward(passed: Stage, stage: Stage) -> None:
    closure = replace(MEASURED, passed=passed)
    if stage < passed:
        with pytest.raises(ValueError, match=f"passed {passed}.*{stage} comes before"):
            closure.rejected(stage, "no")
        with pytest.raises(ValueError, match="comes before"):
            closure.accepted(stage)
    else:
        assert closure.rejected(stage, "no").rejected_at is stage
        assert closure.accepted(stage).passed is stage


@pytest.mark.parametrize("stage", Stage)
def test_what_is_rejected_stays_so(stage: Stage) -> None:
    rejected = MEASURED.rejected(Stage.CONSISTENCY, "inconsistent")
    for decide in (rejected.accepted, rejected.rejected):
        with pytest.raises(ValueError, match="alpha 3 to beta 4, rejected at consistency: inconsistent"):
            decide(stage, "again")
    with pytest.raises(ValueError, match="was decided on"):
        rejected.measured_as(Measured(AHEAD, np.eye(6)))


def test_a_closure_is_measured_once_and_before_it_passes_registration() -> None:
    with pytest.raises(ValueError, match="was measured before"):
        MEASURED.measured_as(Measured(AHEAD, np.eye(6)))
    for stage in Stage:
        if stage >= Stage.REGISTRATION:
            with pytest.raises(ValueError, match="has no measured pose"):
                PROPOSED.accepted(stage)
    for stage in LATER:
        with pytest.raises(ValueError, match="has no measured pose"):
            PROPOSED.rejected(stage, "no")


def test_contradictory_closures_cannot_be_made() -> None:
    with pytest.raises(ValueError, match="registration comes before that"):
        replace(MEASURED, passed=Stage.CONSISTENCY, rejected_at=Stage.REGISTRATION)


def test_how_many_survived_a_stage_is_a_count_over_one_list() -> None:
    closures = [
        PROPOSED.rejected(Stage.REGISTRATION, "too few points"),
        MEASURED.rejected(Stage.RADIO_CHECK, "too far"),
        MEASURED.rejected(Stage.CONSISTENCY, "inconsistent"),
        MEASURED.accepted(Stage.CONSISTENCY).rejected(Stage.ESTIMATE, "contradicts the estimate"),
        MEASURED.accepted(Stage.ESTIMATE),
    ]
    assert [len(survivors(closures, stage)) for stage in Stage] == [5, 4, 3, 2, 1]
    assert survivors(closures, Stage.ESTIMATE) == closures[4:]


def test_its_best_pose_is_measured_else_predicted_else_turned_by_scan_contexts_yaw() -> None:
    prediction = Prediction(se3.from_yaw(0.2, np.ones(3)), np.eye(6), PredictionKind.POSE)
    predicted = replace(PROPOSED, prediction=prediction)
    np.testing.assert_array_equal(PROPOSED.best_T_query_match, se3.from_yaw(0.5, np.zeros(3)))
    np.testing.assert_array_equal(predicted.best_T_query_match, prediction.T_query_match)
    measured = predicted.measured_as(Measured(AHEAD, np.eye(6)))
    np.testing.assert_array_equal(measured.best_T_query_match, AHEAD)
    assert measured.prediction is prediction  # a measurement does not replace what was predicted
    np.testing.assert_array_equal(Closure(PROPOSED.query, PROPOSED.match).best_T_query_match, np.eye(4))


def test_measured_poses_are_stacked_and_missing_ones_named() -> None:
    T_query_match, covariance = measured_poses([MEASURED, MEASURED])
    assert (T_query_match.shape, covariance.shape) == ((2, 4, 4), (2, 6, 6))
    np.testing.assert_array_equal(T_query_match[1], AHEAD)
    assert [part.shape for part in measured_poses([])] == [(0, 4, 4), (0, 6, 6)]
    with pytest.raises(ValueError, match="alpha 3 to beta 4, passed matching"):
        measured_poses([MEASURED, PROPOSED])


def test_a_closure_is_shown_in_one_short_line_without_arrays() -> None:
    assert repr(PROPOSED) == "Closure(alpha 3 to beta 4, passed matching)"
    assert repr(MEASURED.rejected(Stage.RADIO_CHECK, "too far")) == (
        "Closure(alpha 3 to beta 4, rejected at radio check: too far)"
    )
