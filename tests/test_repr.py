"""Nouns show in one short line: names, counts and figures, never an array."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.config import PoseGraphSettings
from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.drift import DriftModel
from wiclosure.frontends.front_end_result import Descriptors, FrontEndCounts, FrontEndResult, OdometryResult
from wiclosure.types import (
    AlignmentHypothesis,
    CandidatePairs,
    Closure,
    FilterResult,
    FrameAlignment,
    KeyframeId,
    Measured,
    Prediction,
    PredictionKind,
    RadioLinks,
    RegistrationEvidence,
    Trajectory,
)

T = se3.from_yaw(0.5, np.array([3.0, 4.0, 0.0]))
COVARIANCE = np.diag(np.repeat([0.02**2, 0.5**2], 3))
PAIRS = CandidatePairs.without_prediction("alpha", "beta", np.arange(3), np.arange(3))
BEST = AlignmentHypothesis(T, -12.34, ((0, 0), (1, -1)))
ALIGNMENT = FrameAlignment("alpha", "beta", BEST, COVARIANCE, ambiguous=False, reason="12 paths agree")
POSES = se3.from_yaw(0.0, np.arange(4)[:, None] * [1.0, 0.0, 0.0])
STAMPS_NS = np.arange(4) * 10**9
FOLLOWED = OdometryResult(
    STAMPS_NS, STAMPS_NS, POSES, np.array([0, 2]), (np.ones((5, 3), np.float32),) * 2, FrontEndCounts(6, 2), 0.1, 0.1
)
DESCRIBED = Descriptors(np.zeros((2, 20, 60), np.float32), 0.1)


def links(count: int) -> RadioLinks:
    index, vectors = np.arange(count), np.zeros((count, 3))
    numbers, matrices = np.ones(count), np.zeros((count, 3, 3))
    sees = np.ones(count, bool)
    return RadioLinks(
        "alpha", "beta", T, COVARIANCE, index, index, vectors, vectors, sees, numbers, numbers, vectors, matrices
    )


def graph() -> GraphResult:
    odometry = {name: Trajectory(name, STAMPS_NS, POSES) for name in ("alpha", "beta", "gamma")}
    closure = Closure.from_measurement(KeyframeId("alpha", 1), KeyframeId("beta", 1), np.eye(4), COVARIANCE)
    return optimise(odometry, [closure], PoseGraphSettings())


@pytest.mark.parametrize(
    ("noun", "shown"),
    [
        (
            Prediction(T, COVARIANCE, PredictionKind.POSE),
            "Prediction(pose, 5.00 m, 0.500 rad, sigma 0.50 m and 0.020 rad)",
        ),
        (
            Measured(T, COVARIANCE, RegistrationEvidence(812, 0.7, 0.98, 0.1)),
            "Measured(5.00 m, 0.500 rad, sigma 0.50 m and 0.020 rad, 812 inliers)",
        ),
        (PAIRS, "CandidatePairs('alpha' and 'beta', 3 pairs, nothing predicted)"),
        (BEST, "AlignmentHypothesis(x 3.00 m, y 4.00 m, z 0.00 m, yaw 0.500 rad, log-likelihood -12.3, 2 paths)"),
        (ALIGNMENT, "FrameAlignment('alpha' and 'beta', certain: 12 paths agree)"),
        (links(12), "RadioLinks('alpha' and 'beta', 12 links)"),
        (
            FilterResult("wiclosure", (PAIRS,), 400, (ALIGNMENT,), seconds=0.123),
            "FilterResult('wiclosure', 3 of 400 pairs kept, 1 of 1 alignments certain, 0.12 s)",
        ),
        (FOLLOWED, "OdometryResult(4 of 6 scans followed, 2 keyframes)"),
        (DESCRIBED, "Descriptors(2 keyframes, 20 rings, 60 sectors)"),
        (
            FrontEndResult.of("alpha", DriftModel(), FOLLOWED, DESCRIBED),
            "FrontEndResult('alpha', 4 scans, 2 keyframes, 3.0 m)",
        ),
        (graph(), "GraphResult(alpha and beta; gamma; 1 of 1 closures accepted)"),
        (MergedMap(np.zeros((7, 3), np.float32), np.zeros((7, 3), np.uint8)), "MergedMap(7 points)"),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else "",
)
def test_a_noun_shows_in_one_short_line(noun: object, shown: str) -> None:
    assert repr(noun) == shown
