from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.frontends.registration.initial_guesses import around_prediction, around_scan_context
from wiclosure.types import FloatArray, Prediction, PredictionKind

TRUTH = se3.from_yaw(0.6, np.array([5.0, -2.0, 0.1]))


def test_starts_go_around_the_circle_from_scan_contexts_yaw() -> None:
    starts = around_scan_context(1.0, 4)
    np.testing.assert_allclose(starts[:, :3, 3], 0.0)
    np.testing.assert_allclose(np.exp(1j * se3.yaw(starts)), np.exp(1j * (1.0 + np.arange(4) * np.pi / 2)), atol=1e-12)


def pose_near_truth(covariance: FloatArray, kind: PredictionKind = PredictionKind.POSE) -> Prediction:
    return Prediction(TRUTH, covariance, kind)


def test_a_sure_prediction_is_one_start_and_a_vague_one_is_searched_around() -> None:
    sure = np.diag(np.square([0.01, 0.01, 0.02, 0.5, 0.5, 0.1]))
    np.testing.assert_allclose(around_prediction(pose_near_truth(sure), None, 0.5), TRUTH[None], atol=1e-12)
    vague = np.diag(np.square([0.01, 0.01, 0.5, 8.0, 1.0, 0.1]))
    starts = around_prediction(pose_near_truth(vague), 0.6 + 1.0, 0.5)
    along = [se3.between(TRUTH, start)[0, 3] for start in starts]
    assert {round(x, 6) for x in along} == {0.0, 12.0, -12.0}
    turns = [float(se3.yaw(se3.between(TRUTH, start))) for start in starts]
    assert {round(x, 6) for x in turns} == {0.0, 0.75, -0.75, 1.0}
    lost = np.diag(np.square([0.01, 0.01, 2.0, 0.5, 0.5, 0.1]))
    yaws = np.sort(se3.yaw(around_prediction(pose_near_truth(lost), None, 0.5)))
    np.testing.assert_allclose(np.diff(yaws), np.pi / 4)


def test_where_only_the_heading_is_predicted_no_start_lies_apart() -> None:
    vague = np.diag(np.square([0.02, 0.02, 0.1, 17.0, 17.0, 2.0]))
    starts = around_prediction(pose_near_truth(vague, PredictionKind.HEADING), None, 0.5)
    np.testing.assert_allclose(starts, TRUTH[None], atol=1e-12)
    assert len(around_prediction(pose_near_truth(vague), None, 0.5)) == 5
