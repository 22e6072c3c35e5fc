from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.pipeline.evaluation.closures import TruthCheck, candidate_metrics, closure_errors, closure_metrics
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.types import CandidatePairs, Closure, KeyframeId, Stage, Trajectory

SEEDS = st.integers(0, 2**32 - 1)


def brute_force(pairs, positions, radius):
    a, b = positions["alpha"], positions["beta"]
    near = np.linalg.norm(a[:, None] - b[None], axis=2) <= radius
    kept = np.zeros_like(near)
    kept[pairs.index_a, pairs.index_b] = True
    return int(near.sum()), int((near & kept).sum()), int(kept.sum())


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, radius=st.floats(1.0, 200.0), share=st.floats(0.0, 1.0))
def test_candidate_metrics_agree_with_brute_force(path, seed, radius, share):
    rng = np.random.default_rng(seed)
    truth = {"alpha": path(seed, 30), "beta": path(seed + 1, 40, "beta")}
    index_a, index_b = np.nonzero(rng.random((30, 40)) < share)
    pairs = CandidatePairs.without_prediction("alpha", "beta", index_a, index_b)
    true, kept_true, kept = brute_force(pairs, {r: t.positions for r, t in truth.items()}, radius)
    found = candidate_metrics([pairs], truth, truth, radius_m=radius, gap_s=1.0)
    assert (found["true"], found["kept_true"]) == (true, kept_true)
    assert found["pruned"] == pytest.approx(1 - kept / 1200)
    assert found["recall"] == (kept_true / true if true else None)
    assert found["precision"] == (kept_true / kept if kept else None)


class TestClosures:
    """Two robots on straight lines 3 m apart; closures with errors of known size."""

    STAMPS_NS = np.arange(10) * 10**9

    def line(self, robot, y):
        poses = np.tile(np.eye(4), (10, 1, 1))
        poses[:, 0, 3], poses[:, 1, 3] = np.arange(10.0), y
        return Trajectory(robot, self.STAMPS_NS, poses)

    def truth_check(self, truth=None, error_m=2.0, error_deg=5.0):
        keyframes = {"alpha": self.line("alpha", 0.0), "beta": self.line("beta", 3.0)}
        return TruthCheck(keyframes, keyframes if truth is None else truth, error_m, error_deg, 1.0)

    def closure(self, a, b, metres=0.0, degrees=0.0):
        T = se3.from_yaw(np.radians(degrees), np.array([b - a + metres, 3.0, 0.0]))
        return Closure.from_measurement(KeyframeId("alpha", a), KeyframeId("beta", b), T, np.eye(6))

    def test_errors_are_those_that_were_put_in(self):
        truth_check = self.truth_check()
        closures = [self.closure(0, 1), self.closure(2, 5, metres=1.5), self.closure(3, 3, degrees=-30.0)]
        metres, degrees, covered = closure_errors(closures, truth_check.keyframes, truth_check.truth, 1.0)
        np.testing.assert_allclose(metres, [0.0, 1.5, 0.0], atol=1e-12)
        np.testing.assert_allclose(degrees, [0.0, 0.0, 30.0], atol=1e-5)
        assert covered.all()

    @pytest.mark.parametrize(("metres", "degrees", "right"), [(1.9, 4.9, True), (2.1, 0.0, False), (0.0, 5.1, False)])
    def test_a_closure_is_true_within_both_limits(self, metres, degrees, right):
        found, covered = self.truth_check().right([self.closure(4, 4, metres, degrees)])
        assert (bool(found[0]), bool(covered[0])) == (right, True)

    def test_closures_without_ground_truth_are_neither_true_nor_false(self):
        early = self.line("alpha", 0.0)
        early = Trajectory("alpha", early.stamps_ns[:5], early.poses[:5])
        truth = {"alpha": early, "beta": self.line("beta", 3.0)}
        truth_check = self.truth_check(truth)
        assert truth_check.count([self.closure(1, 1), self.closure(2, 2, 9.0), self.closure(9, 9)]) == (1, 1)
        assert truth_check.count([self.closure(9, 9)]) == (None, None)
        assert truth_check.count([]) == (0, 0)
        assert self.truth_check({}).count([]) == (None, None)

    def test_places_are_near_whatever_was_measured(self):
        truth_check = self.truth_check()
        closures = [self.closure(0, 0, 50.0), self.closure(0, 4), self.closure(0, 9)]
        assert truth_check.near(closures, truth_check.truth, 5.0) == (2, 1)
        assert truth_check.near(closures, {}, 5.0) == (None, None)

    def test_decisions_and_truth_are_counted(self):
        checked = self.closure(1, 1).accepted(Stage.RADIO_CHECK)
        closures = [
            checked.accepted(Stage.ESTIMATE),
            self.closure(2, 2, 9.0).accepted(Stage.ESTIMATE),
            self.closure(3, 3).rejected(Stage.CONSISTENCY, "alone"),
            self.closure(4, 4).rejected(Stage.REGISTRATION, "too few points"),
        ]
        assert closure_metrics(closures, self.truth_check()) == {
            "proposed": 4,
            "verified": 3,
            "accepted": 2,
            "verified_true": 2,
            "verified_false": 1,
            "accepted_true": 1,
            "accepted_false": 1,
        }


def test_the_check_against_truth_has_the_limits_of_the_settings(path):
    truth = {robot: path(seed, robot=robot) for seed, robot in enumerate(("alpha", "beta"))}
    settings = EvaluationSettings(closure_error_m=0.5, closure_error_deg=3.0, ground_truth_gap_s=0.25)
    truth_check = TruthCheck.of(settings, truth, {"alpha": truth["alpha"]})
    assert (truth_check.error_m, truth_check.error_deg, truth_check.gap_s) == (0.5, 3.0, 0.25)
    assert set(truth_check.truth) == {"alpha"}
    assert truth_check.keyframes is truth
