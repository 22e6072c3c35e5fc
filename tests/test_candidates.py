from __future__ import annotations

import numpy as np
import pytest

from wiclosure.candidates import CandidatePairs, robot_pairs
from wiclosure.types import PredictionKind


class ByIndex:
    """Predicts that match j lies j - i metres ahead of query i, with a variance of i."""

    kind = PredictionKind.POSE

    def relative_poses(self, robot_a, index_a, robot_b, index_b):
        assert (robot_a, robot_b) == ("alpha", "beta")
        T_a_b = np.tile(np.eye(4), (len(index_a), 1, 1))
        T_a_b[:, 0, 3] = index_b - index_a
        return T_a_b, np.eye(6) * index_a[:, None, None]


INDEX_A, INDEX_B = np.array([1, 2, 5]), np.array([4, 2, 7])


def test_predictions_are_asked_for_by_row():
    known = np.ones(3)
    pairs = CandidatePairs("alpha", "beta", INDEX_A, INDEX_B, known, known, ByIndex())
    T_a_b, covariance = pairs.predicted(np.array([2, 0]))
    assert T_a_b[:, 0, 3].tolist() == [2.0, 3.0]
    assert covariance[:, 5, 5].tolist() == [5.0, 1.0]
    assert pairs.predicts is PredictionKind.POSE
    assert len(pairs) == 3


def test_pairs_without_prediction_state_nothing():
    pairs = CandidatePairs.without_prediction("alpha", "beta", INDEX_A, INDEX_B)
    assert np.isnan(pairs.mahalanobis).all()
    assert np.isnan(pairs.overlap_probability).all()
    assert pairs.predicted(np.array([0])) is None
    assert pairs.predicts is None


@pytest.mark.parametrize("name", ["index_b", "overlap_probability", "mahalanobis"])
def test_arrays_of_other_lengths_are_refused(name):
    arrays = dict.fromkeys(["index_a", "index_b"], INDEX_A) | dict.fromkeys(
        ["overlap_probability", "mahalanobis"], np.ones(3)
    )
    with pytest.raises(ValueError, match=rf"candidate {name} has shape \(2,\), index_a \(3,\)"):
        CandidatePairs("alpha", "beta", **arrays | {name: arrays[name][:2]})


def test_each_two_robots_are_a_pair_once_in_their_order():
    assert list(robot_pairs(["c", "a", "b"])) == [("c", "a"), ("c", "b"), ("a", "b")]
    assert list(robot_pairs(["a"])) == []
