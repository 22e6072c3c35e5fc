from __future__ import annotations

import numpy as np

from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.pipeline.report.html.candidates_data import Overlap, candidate_matrices
from wiclosure.pipeline.report.html.packing import unpacked_array
from wiclosure.types import CandidatePairs, Closure, KeyframeId, Measured, Stage, Trajectory

SECOND_NS = 10**9


def line(robot: str, n: int, y_m: float = 0.0) -> Trajectory:
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = np.arange(n), y_m
    return Trajectory(robot, SECOND_NS * np.arange(1, n + 1), poses)


def test_small_matrices_have_a_bin_for_each_pair() -> None:
    a, b = line("a", 4), line("b", 5, y_m=1.0)
    pairs = CandidatePairs.without_prediction("a", "b", np.array([0, 1, 3]), np.array([0, 4, 2]))
    settings = EvaluationSettings(overlap_radius_m=1.1)
    (found,) = candidate_matrices([pairs], {"a": a, "b": b}, overlap=Overlap({"a": a, "b": b}, settings))
    kept, overlap = unpacked_array(found["kept"]), unpacked_array(found["overlap"])
    assert kept.shape == (4, 5)
    assert np.argwhere(kept == 255).tolist() == [[0, 0], [1, 4], [3, 2]]
    assert np.argwhere(overlap).tolist() == [[0, 0], [1, 1], [2, 2], [3, 3]]  # side by side, 1 m apart
    assert (found["pairs_kept"], found["pairs_total"]) == (3, 20)
    assert (found["seconds"], found["metres"]) == ([3.0, 4.0], [3.0, 4.0])


def test_large_matrices_are_binned_and_every_pair_counted() -> None:
    a, b = line("a", 1000), line("b", 700)
    rng = np.random.default_rng(0)
    pairs = CandidatePairs.without_prediction("a", "b", rng.integers(0, 1000, 5000), rng.integers(0, 700, 5000))
    (found,) = candidate_matrices([pairs], {"a": a, "b": b})
    assert unpacked_array(found["kept"]).shape == (200, 200)
    assert found["overlap"] is None
    assert np.sum(found["parts"]["kept"]) == 5000
    assert np.shape(found["parts"]["kept"]) == (10, 10)
    alone = CandidatePairs.without_prediction("a", "b", np.array([999]), np.array([699]))
    (found,) = candidate_matrices([alone], {"a": a, "b": b})
    assert np.argwhere(unpacked_array(found["kept"])).tolist() == [[199, 199]]  # one pair among many stays visible


def test_accepted_closures_are_marked_whichever_robot_asked() -> None:
    a, b = line("a", 10), line("b", 10)
    pairs = CandidatePairs.without_prediction("a", "b", np.array([1]), np.array([2]))
    measured = Measured(np.eye(4), np.eye(6))
    ends = [(("a", 1), ("b", 2)), (("b", 9), ("a", 4))]
    closures = [
        Closure(KeyframeId(*query), KeyframeId(*match)).measured_as(measured).accepted(Stage.ESTIMATE)
        for query, match in ends
    ]
    (found,) = candidate_matrices([pairs], {"a": a, "b": b}, closures)
    np.testing.assert_allclose(unpacked_array(found["closures"]), [[0.15, 0.25], [0.45, 0.95]])


def test_no_ground_truth_or_none_there_tells_no_overlap() -> None:
    a, b = line("a", 3), line("b", 3)
    pairs = CandidatePairs.without_prediction("a", "b", np.zeros(0, int), np.zeros(0, int))
    later = Trajectory("a", a.stamps_ns + 10**12, a.poses)
    for truth in ({}, {"a": a}, {"a": later, "b": b}):
        (found,) = candidate_matrices([pairs], {"a": a, "b": b}, overlap=Overlap(truth, EvaluationSettings()))
        assert found["overlap"] is None
        assert not unpacked_array(found["kept"]).any()
