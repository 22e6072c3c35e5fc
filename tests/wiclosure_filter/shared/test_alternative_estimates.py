"""Ranges from a straight road leave two answers, one on each side of it; scans near either of them may be compared."""

from __future__ import annotations

import json

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.formats.filter_summary import filter_summary
from wiclosure.types import (
    FilterResult,
    FloatArray,
    Heading,
    PredictionKind,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.config import FilterSettings, GateSettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.shared.alternative_estimates import AlternativeEstimates

STRAIGHT = 60  # metres, one keyframe each, before the robot turns
REACH_M = 8.0
SETTINGS = FilterSettings(gate=GateSettings(sensor_range_m=REACH_M))
DRIFT = DriftModel(translation_walk=0.01, rotation_walk=0.0005)


def drive(start: tuple[float, float], heading: float, bend: float) -> FloatArray:
    """World poses: straight on for a while, then a long bend."""
    yaw = heading + np.concatenate([np.zeros(STRAIGHT), np.linspace(0, bend, 60)])
    steps = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(120)], axis=1)
    return se3.from_yaw(yaw, np.cumsum(steps, axis=0) + np.array([*start, 0.0]))


def world(side: int) -> dict[str, Trajectory]:
    stamps_ns = np.arange(120, dtype=np.int64) * 10**9
    return {
        "alpha": Trajectory("alpha", stamps_ns, drive((0.0, 0.0), 0.0, -2.5), DRIFT),
        "beta": Trajectory("beta", stamps_ns, drive((85.0, side * 6.0), np.pi, 2.5), DRIFT),
    }


def heard(truth: dict[str, Trajectory]) -> WirelessLog:
    """A range every 5 m while both drive straight, and both compasses."""
    rng = np.random.default_rng(3)
    rows = range(0, STRAIGHT, 5)
    apart = truth["beta"].positions - truth["alpha"].positions
    ranges = tuple(
        WirelessMeasurement(k * 10**9, "alpha", "beta", float(np.linalg.norm(apart[k]) + rng.normal(0, 0.2)), 0.3)
        for k in rows
    )
    headings = tuple(
        Heading(k * 10**9, robot, float(se3.yaw(t.poses[k]) + rng.normal(0, 0.01)), 0.02)
        for robot, t in truth.items()
        for k in rows
    )
    return WirelessLog(ranges, headings)


def filtered(side: int, settings: FilterSettings = SETTINGS) -> tuple[FilterResult, dict[str, Trajectory]]:
    truth = world(side)
    odometry = {name: t.moved(se3.inverse(t.poses[0])) for name, t in truth.items()}
    return WiClosureFilter(settings).candidates(odometry, heard(truth)), truth


@pytest.mark.parametrize("side", [1, -1])
def test_pairs_near_under_either_answer_are_kept_and_no_others(side: int) -> None:
    result, truth = filtered(side)
    (alignment,), (pairs,) = result.alignments, result.pairs
    assert alignment.ambiguous
    assert len(alignment.likely_alternatives) == 1
    assert alignment.likely_alternatives[0] is alignment.best_alternative
    apart_m = np.linalg.norm(truth["alpha"].positions[:, None] - truth["beta"].positions[None], axis=2)
    kept = np.zeros(apart_m.shape, bool)
    kept[pairs.index_a, pairs.index_b] = True
    assert kept[apart_m < REACH_M - 1].all()
    mirrored = world(-side)
    apart_there_m = np.linalg.norm(mirrored["alpha"].positions[:, None] - mirrored["beta"].positions[None], axis=2)
    assert (np.minimum(apart_m, apart_there_m)[kept] < 2 * REACH_M).all()
    assert (apart_m[kept] > 2 * REACH_M).any(), "the other answer is not allowed for"
    assert any("possible under one of 2 likely alignments" in sentence for sentence in result.diagnosis)


@pytest.mark.parametrize("side", [1, -1])
def test_predictions_hold_the_truth(side: int) -> None:
    result, truth = filtered(side)
    (pairs,) = result.pairs
    near = np.linalg.norm(truth["alpha"].positions[pairs.index_a] - truth["beta"].positions[pairs.index_b], axis=1)
    rows = np.flatnonzero(near < REACH_M)
    predicted = pairs.predicted(rows)
    assert predicted is not None
    a, b = truth["alpha"].poses[pairs.index_a[rows]], truth["beta"].poses[pairs.index_b[rows]]
    error = se3.log(se3.between(predicted[0], se3.between(a, b)))
    chi2 = np.einsum("mi,mi->m", error, np.linalg.solve(predicted[1], error[:, :, None])[:, :, 0])
    assert (chi2 < 22.5).all()  # 99.9 % of six degrees of freedom


def test_a_pair_possible_under_one_answer_only_is_predicted_by_that_one() -> None:
    result, _ = filtered(1)
    (pairs,) = result.pairs
    assert isinstance(pairs.predictor, AlternativeEstimates)
    assert (pairs.predicts, pairs.predictor.alternatives) == (PredictionKind.POSE, 2)
    single = [
        pairs.predictor.overlap_probability(e, "alpha", pairs.index_a, "beta", pairs.index_b)
        for e in pairs.predictor.estimates
    ]
    only_first = np.flatnonzero((single[0] > 0) & (single[1] == 0))
    assert len(only_first) > 0
    predicted = pairs.predicted(only_first)
    assert predicted is not None
    expected = pairs.predictor.estimates[0].relative_poses(
        "alpha", pairs.index_a[only_first], "beta", pairs.index_b[only_first]
    )
    np.testing.assert_allclose(predicted[0], expected[0], atol=1e-9)
    np.testing.assert_allclose(predicted[1], expected[1], rtol=1e-9, atol=1e-12)


def test_the_budget_and_other_answers_to_ambiguity_hold_here_too() -> None:
    whole, _ = filtered(1)
    best, _ = filtered(1, SETTINGS.model_copy(update={"gate": GateSettings(sensor_range_m=REACH_M, budget=20)}))
    assert best.pairs_kept == 20 < whole.pairs_kept
    assert best.pairs[0].overlap_probability.min() >= np.sort(whole.pairs[0].overlap_probability)[-20]
    assert filtered(1, SETTINGS.model_copy(update={"on_ambiguous": "reject"}))[0].pairs_kept == 0
    with pytest.raises(InputError, match="does not tell how alpha and beta lie"):
        filtered(1, SETTINGS.model_copy(update={"on_ambiguous": "raise"}))


def test_the_summary_names_the_alternatives() -> None:
    summary = json.loads(json.dumps(filter_summary(filtered(1)[0])))
    (alignment,) = summary["alignments"]
    assert len(alignment["rivals"]) == 1
    assert alignment["rivals"][0] == alignment["runner_up"]
