from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.pipeline.evaluation.closures import TruthCheck, candidate_metrics
from wiclosure.pipeline.evaluation.funnel import MEASURED, STAGES, funnel
from wiclosure.types import CandidatePairs, Closure, FilterResult, KeyframeId, Stage


def test_each_stage_counts_what_it_leaves(path):
    """One true closure is lost at each stage, and one is left; the false one is lost at the radio check."""
    truth = {"alpha": path(1), "beta": path(2, robot="beta")}
    every = np.arange(80)
    pairs = CandidatePairs.without_prediction("alpha", "beta", every[:50], every[:50])

    def closure(index, error_m=0.0):
        T = se3.between(truth["alpha"].poses[index], truth["beta"].poses[index])
        T = T @ se3.from_yaw(0.0, np.array([error_m, 0.0, 0.0]))
        return Closure.from_measurement(KeyframeId("alpha", index), KeyframeId("beta", index), T, np.eye(6))

    closures = [closure(index).rejected(stage, "for the test") for index, stage in enumerate(MEASURED.values())]
    closures += [closure(10).accepted(Stage.ESTIMATE), closure(11, 30.0).rejected(Stage.RADIO_CHECK, "far off")]
    truth_check = TruthCheck(truth, truth, 2.0, 5.0, 1.0)
    candidates = candidate_metrics([pairs], truth, truth, radius_m=1e4, gap_s=1.0)
    rows = funnel(candidates, FilterResult("wiclosure", (pairs,), 6400), closures, truth, truth_check)
    assert tuple(row["stage"] for row in rows) == STAGES
    assert [(row["count"], row["true"], row["false"]) for row in rows] == [
        (6400, 6400, 0),
        (50, 50, 0),
        (6, 6, 0),  # within 10 km of each other all are places alike
        (5, 4, 1),
        (3, 3, 0),
        (2, 2, 0),
        (1, 1, 0),
    ]


def test_without_ground_truth_only_counts_are_left(path):
    keyframes = {"alpha": path(1), "beta": path(2, robot="beta")}
    candidates = candidate_metrics([], keyframes, {}, radius_m=35.0, gap_s=1.0)
    rows = funnel(candidates, FilterResult("none", (), 0), [], {}, TruthCheck(keyframes, {}, 2.0, 5.0, 1.0))
    assert [(row["count"], row["true"], row["false"]) for row in rows] == [(0, None, None)] * len(STAGES)
