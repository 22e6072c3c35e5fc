from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise, PcmSettings
from wiclosure.backends.consistency.clique import consistency_matrix
from wiclosure.backends.consistency.incremental import IncrementalConsistency
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.types import Closure, KeyframeId, Prediction, PredictionKind, Stage, survivors

EXACT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)


def test_perfect_closures_make_one_full_clique(team_maker):
    for seed in range(5):
        team, rng = team_maker(seed), np.random.default_rng(seed)
        assert pairwise_consistent(team.random_closures(8, rng), team.odometry, PcmSettings()).pairs[0].kept == 8


def test_the_direction_of_a_closure_does_not_matter(team_maker):
    team, rng = team_maker(3, noise=1.0), np.random.default_rng(3)
    closures = team.random_closures(12, rng, noise=rng)
    turned = [
        Closure.from_measurement(
            c.match,
            c.query,
            se3.inverse(c.measured.T_query_match),
            se3.inverse_covariance(c.measured.T_query_match, c.measured.covariance),
        )
        for c in closures
    ]
    matrices = []
    for version in (closures, turned):
        (closure_set,), _ = closure_sets(version, team.odometry, EXACT)
        matrices.append(consistency_matrix(closure_set, team.odometry, PcmSettings()))
    np.testing.assert_array_equal(*matrices)


def test_false_closures_are_rejected_with_a_reason_and_true_ones_accepted(team_maker):
    team, rng = team_maker(1, noise=1.0), np.random.default_rng(1)
    true = team.random_closures(15, rng, noise=rng)
    false = [team.false_closure(("alpha", int(a)), ("beta", int(b)), rng) for a, b in rng.integers(0, 60, (60, 2))]
    result = pairwise_consistent(true + false, team.odometry, PcmSettings())
    assert [c.rejected_at for c in result.closures[15:]] == [Stage.CONSISTENCY] * 60
    assert len(survivors(result.closures[:15], Stage.CONSISTENCY)) >= 14
    assert "contradicts what the other closures and odometry predict" in result.closures[20].reason
    assert result.closures[0].consistent_with >= 10


@pytest.mark.parametrize(("count", "kept"), [(1, 0), (2, 2), (3, 3)])
def test_one_closure_cannot_be_checked_but_two_can(team_maker, count, kept):
    team, rng = team_maker(2, noise=1.0), np.random.default_rng(2)
    result = pairwise_consistent(team.random_closures(count, rng), team.odometry, PcmSettings())
    assert result.pairs[0].kept == kept
    assert ("cannot be checked" in result.diagnosis[0]) == (count == 1)


@pytest.mark.parametrize("predicted", [False, True])
def test_neighbours_of_one_place_need_a_prediction(team_maker, predicted):
    """Keyframes next to each other see one look-alike place from one false pose: they agree, and are all wrong."""
    team = team_maker(2)
    prediction = Prediction(np.eye(4), np.eye(6), PredictionKind.POSE) if predicted else None
    elsewhere = se3.from_yaw(0.0, np.array([30.0, 0.0, 0.0]))
    closures = [
        replace(
            Closure.from_measurement(
                KeyframeId("alpha", 10 + n),
                KeyframeId("beta", 20 + n),
                se3.between(team.truth["alpha"].poses[10 + n], elsewhere @ team.truth["beta"].poses[20 + n]),
                np.diag([1e-4] * 6),
            ),
            prediction=prediction,
        )
        for n in range(3)
    ]
    result = pairwise_consistent(closures, team.odometry, PcmSettings())
    assert result.pairs[0].kept == (3 if predicted else 0)
    assert predicted or "look-alike" in result.closures[0].reason


def test_two_sets_of_one_size_that_contradict_each_other_are_ambiguous(team_maker):
    team, rng = team_maker(4), np.random.default_rng(4)
    shifted = team.random_closures(5, rng)
    mirror = se3.from_yaw(0.0, np.array([30.0, 0.0, 0.0]))  # beta's whole frame 30 m off, as a row of equal houses does
    for n, c in enumerate(shifted):
        query = team.truth["alpha"].poses[c.query.index]
        match = mirror @ team.truth["beta"].poses[c.match.index]
        shifted[n] = team.remeasured(c, T_query_match=se3.between(query, match))
    closures = team.random_closures(5, rng) + shifted
    result = pairwise_consistent(closures, team.odometry, PcmSettings())
    assert result.pairs[0].contradicting == result.pairs[0].largest == 5
    assert "ambiguous" in result.diagnosis[0]
    assert all(c.rejected_at is Stage.CONSISTENCY for c in result.closures)
    assert pairwise_consistent(closures, team.odometry, PcmSettings(method="clique")).pairs[0].kept == 5


@pytest.mark.parametrize(("shifted", "believed"), [(7, False), (4, True)])
def test_a_rival_nearly_as_large_is_ambiguous_and_a_small_one_is_not(team_maker, shifted, believed):
    team, rng = team_maker(4), np.random.default_rng(4)
    mirror = se3.from_yaw(0.0, np.array([30.0, 0.0, 0.0]))
    false = [
        team.remeasured(
            c,
            T_query_match=se3.between(
                team.truth["alpha"].poses[c.query.index], mirror @ team.truth["beta"].poses[c.match.index]
            ),
        )
        for c in team.random_closures(shifted, rng)
    ]
    found = pairwise_consistent(team.random_closures(8, rng) + false, team.odometry, PcmSettings())
    said, pair = found.doubts, found.pairs[0]
    assert (pair.largest, pair.contradicting, pair.kept, pair.ambiguous) == (8, shifted, 8 * believed, not believed)
    assert [f"8 closures agree with each other and are accepted, but {shifted} others" in one for one in said] == (
        [True] if believed else []
    )
    assert found.diagnosis == (*said, *found.remarks)
    assert believed or f"two sets of 8 and {shifted} closures" in pair.sentence


@pytest.mark.parametrize(("stretch", "doubted"), [(60, True), (8, False)])
def test_a_rival_is_as_strong_by_the_share_of_the_paths_that_it_spans(team_maker, stretch, doubted):
    """Along a stretch that looks like another any number agrees; at one place they tell as little as one does."""
    team, rng = team_maker(4), np.random.default_rng(4)
    T_wrong = se3.from_yaw(0.0, np.array([30.0, 0.0, 0.0]))
    alpha, beta = (team.truth[robot].poses for robot in ("alpha", "beta"))
    alike = [
        team.remeasured(c, T_query_match=se3.between(alpha[c.query.index], T_wrong @ beta[c.match.index]))
        for c in team.random_closures(12, rng, limit=stretch)
    ]
    found = pairwise_consistent([*team.random_closures(40, rng), *alike], team.odometry, PcmSettings())
    assert found.pairs[0].kept == 40
    assert found.pairs[0].rival == 12 * doubted
    assert bool(found.pairs[0].doubt) == doubted


def test_closures_that_third_robots_settle_are_no_rival_of_themselves(team_maker):
    """Neighbours of one place are objected to until third robots support them; nothing else contradicts them then."""
    team, rng = team_maker(5, ("a", "b", "c"), noise=1.0), np.random.default_rng(5)
    spread = [
        team.closure((one, int(i)), (other, int(j)), noise=rng)
        for one, other in (("a", "b"), ("b", "c"))
        for i, j in rng.integers(0, 60, (12, 2))
    ]
    at_one_place = [team.closure(("a", 10 + n), ("c", 20 + n), noise=rng) for n in range(3)]
    found = pairwise_consistent(spread + at_one_place, team.odometry, PcmSettings())
    assert [pair.kept for pair in found.pairs] == [3, 12, 12]
    assert found.doubts == ()
    assert pairwise_consistent(at_one_place, team.odometry, PcmSettings()).pairs[0].kept == 0


def test_the_right_set_is_found_among_many_clusters_as_large(team_maker):
    """Five closures at three places hold; six look-alike places have five each, and only so many sets are kept."""
    team, rng = team_maker(7, noise=1.0, n=120), np.random.default_rng(7)
    true = [
        team.closure(("alpha", i), ("beta", j), noise=rng) for i, j in ((3, 5), (4, 6), (5, 7), (60, 80), (100, 30))
    ]
    alpha, beta = (team.truth[r].poses for r in ("alpha", "beta"))
    alike = []
    for _ in range(6):
        i, j = rng.integers(0, 110, 2)
        shift = alpha[i] @ se3.from_yaw(rng.uniform(-np.pi, np.pi), rng.normal(0, 1, 3)) @ se3.inverse(beta[j])
        for k in range(5):
            closure = team.closure(("alpha", int(i + k)), ("beta", int(j + k)), noise=rng)
            alike.append(team.remeasured(closure, T_query_match=se3.between(alpha[i + k], shift @ beta[j + k])))
    found = pairwise_consistent([*alike, *true], team.odometry, PcmSettings(noise=EXACT))
    assert [c.live for c in found.closures] == [False] * 30 + [True] * 5


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1), parts=st.lists(st.integers(0, 25), max_size=4), max_scale=st.sampled_from([1, 8])
)
def test_closure_by_closure_gives_the_answer_of_all_at_once(team_maker, seed, parts, max_scale):
    team, rng = team_maker(seed, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(seed)
    closures = team.random_closures(10, rng, noise=rng)
    closures += [team.closure(("gamma", int(a)), ("gamma", int(b)), noise=rng) for a, b in rng.integers(0, 60, (3, 2))]
    for robot in ("beta", "gamma"):
        ends = rng.integers(0, 60, (6, 2))
        closures += [team.false_closure(("alpha", int(a)), (robot, int(b)), rng) for a, b in ends]
    closures = [closures[n] for n in rng.permutation(25)]
    pcm = IncrementalConsistency(PcmSettings(max_scale=max_scale))
    for first, last in pairwise([0, *sorted(parts), 25]):
        until = int(max([20, *(k.index for c in closures[:last] for k in (c.query, c.match))])) + 1
        pcm.add(closures[first:last], {r: t.subset(np.arange(until)) for r, t in team.odometry.items()})
    step_by_step = pcm.result()
    at_once = pairwise_consistent(closures, team.odometry, PcmSettings(max_scale=max_scale))
    assert [(c.rejected_at, c.reason, c.consistent_with) for c in step_by_step.closures] == [
        (c.rejected_at, c.reason, c.consistent_with) for c in at_once.closures
    ]
    assert step_by_step.scale == at_once.scale


@pytest.mark.parametrize("times", [1.0, 4.0])
def test_covariances_stated_too_small_are_enlarged_as_far_as_closures_show(team_maker, times):
    team, rng = team_maker(14, noise=1.0), np.random.default_rng(14)
    closures = team.random_closures(30, rng, noise=rng)
    closures += [team.false_closure(("alpha", int(a)), ("beta", int(b)), rng) for a, b in rng.integers(0, 60, (8, 2))]
    stated = [team.remeasured(c, covariance=c.measured.covariance / times**2) for c in closures]
    small = team.odometry["alpha"].drift.model_dump()
    drift = DriftModel(**{name: value / times for name, value in small.items()})
    odometry = {r: replace(t, drift=drift) for r, t in team.odometry.items()}
    tight = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
    as_stated, fitted = (
        pairwise_consistent(stated, odometry, PcmSettings(noise=tight, max_scale=scale)) for scale in (1.0, 10.0)
    )
    assert fitted.scale == pytest.approx(times, rel=0.25)
    assert fitted.pairs[0].kept >= 28
    assert not survivors(fitted.closures[30:], Stage.CONSISTENCY)
    assert (as_stated.pairs[0].kept >= 28) == (times == 1.0)
    assert ("times as large" in fitted.diagnosis[0]) == (times == 4.0)


def test_a_pair_of_neighbours_that_agrees_among_many_that_do_not_is_put_down_to_chance(team_maker):
    """Closures that all look along one street differ in little, so that two agree now and then."""
    team, rng = team_maker(5), np.random.default_rng(5)
    shared = team.random_closures(1, rng)[0]
    street = [
        team.remeasured(
            replace(
                shared,
                query=replace(shared.query, index=shared.query.index + int(n % 2)),
            ),
            T_query_match=shared.measured.T_query_match @ se3.exp(rng.normal(0, [0.02, 0.02, 0.05, 0.5, 0.5, 0.2])),
        )
        for n in range(12)
    ]
    result = pairwise_consistent(street, team.odometry, PcmSettings())
    assert result.pairs[0].kept == 0
    assert "chance" in result.diagnosis[0]


def test_closures_within_one_robot_must_agree_with_its_odometry(team_maker):
    team, rng = team_maker(6, ("alpha",), noise=1.0), np.random.default_rng(6)
    true = team.closure(("alpha", 50), ("alpha", 3), noise=rng)
    result = pairwise_consistent(
        [true, team.false_closure(("alpha", 40), ("alpha", 5), rng)], team.odometry, PcmSettings()
    )
    assert [c.survived(Stage.CONSISTENCY) for c in result.closures] == [True, False]
    assert "odometry" in result.closures[1].reason


def test_unusable_measurements_are_rejected_with_a_reason_not_an_exception(team_maker):
    team = team_maker(7)
    good = [team.closure(("alpha", i), ("beta", i)) for i in (3, 20, 40)]
    broken = [
        team.remeasured(good[0], T_query_match=np.full((4, 4), np.nan)),
        team.remeasured(good[0], covariance=np.full((6, 6), np.inf)),
        team.remeasured(good[0], covariance=-np.eye(6)),
        replace(good[0], match=good[0].query),
    ]
    result = pairwise_consistent(good + broken, team.odometry, PcmSettings())
    assert [c.reason for c in result.closures[3:]] == [
        "its transform is not finite",
        "its covariance is not finite",
        "its covariance is not positive",
        "closes a keyframe on itself",
    ]
    assert result.pairs[0].kept == 3


def test_singular_covariances_are_usable(team_maker):
    team = team_maker(7)
    closures = [
        team.remeasured(team.closure(("alpha", i), ("beta", i)), covariance=np.zeros((6, 6))) for i in (3, 3, 40)
    ]
    assert pairwise_consistent(closures, team.odometry, PcmSettings()).pairs[0].kept == 3


def test_closures_of_other_stages_pass_unchanged(team_maker):
    team = team_maker(8)
    proposed = Closure(KeyframeId("alpha", 1), KeyframeId("beta", 1))
    rejected = proposed.rejected(Stage.REGISTRATION, "too few points")
    assert pairwise_consistent([proposed, rejected], team.odometry, PcmSettings()).closures == (proposed, rejected)
    assert pairwise_consistent([], team.odometry, PcmSettings()).closures == ()


def test_unknown_keyframes_are_named(team_maker):
    team = team_maker(9)
    closure = team.closure(("alpha", 59), ("beta", 1))
    short = {r: t.subset(np.arange(10)) for r, t in team.odometry.items()}
    with pytest.raises(InputError, match="keyframe 59 of alpha, which has 10 keyframes"):
        pairwise_consistent([closure], short, PcmSettings())
    with pytest.raises(InputError, match="unknown robot 'alpha'"):
        pairwise_consistent([closure], {"beta": team.odometry["beta"]}, PcmSettings())


class TestLegacyCycle:
    """DiSCo-SLAM's cycle, kept to reproduce its results."""

    def test_presets_of_disco_slam_accept_what_the_chi_square_test_does_not(self, team_maker):
        team, rng = team_maker(11), np.random.default_rng(11)
        false = [team.false_closure(("alpha", int(a)), ("beta", int(b)), rng) for a, b in rng.integers(0, 60, (30, 2))]
        loose = PcmSettings(metric="unit", cycle="legacy", unit_threshold=100.0, start_threshold=5)
        assert pairwise_consistent(false, team.odometry, loose).pairs[0].kept >= 10
        assert pairwise_consistent(false, team.odometry, PcmSettings()).pairs[0].kept == 0

    def test_start_threshold_waits_for_enough_closures(self, team_maker):
        team = team_maker(12)
        closures = [team.closure(("alpha", i), ("beta", i)) for i in range(4)]
        result = pairwise_consistent(closures, team.odometry, PcmSettings(metric="unit", start_threshold=5))
        assert result.pairs[0].kept == 0
        assert "start_threshold" in result.diagnosis[0]

    def test_it_has_no_covariance(self):
        with pytest.raises(ValidationError, match="set metric: unit"):
            PcmSettings(cycle="legacy")


class TestRecordedGraphs:
    """Graphs of robust_distributed_mapper, clean and spoiled by false closures between the robots."""

    def test_clean_graph_is_kept_whole(self, data_dir, g2o_loader):
        graph = g2o_loader(data_dir / "pose_graphs/pcm_clean/example_2robots")
        assert (
            pairwise_consistent(graph.closures, graph.odometry, PcmSettings(noise=EXACT)).pairs[0].kept
            == len(graph.closures)
            == 10
        )

    def test_spoiled_graph_loses_exactly_the_false_closures(self, data_dir, g2o_loader):
        graph = g2o_loader(data_dir / "pose_graphs/pcm_spoiled/example_2robots")
        accepted = [
            c.survived(Stage.CONSISTENCY)
            for c in pairwise_consistent(graph.closures, graph.odometry, PcmSettings()).closures
        ]
        assert accepted == [True] * 10 + [False] * 10  # the false ones were appended to the file

    def test_blatant_outliers_of_the_simulated_swarm_are_never_accepted(self, data_dir, g2o_loader):
        graph = g2o_loader(data_dir / "pose_graphs/argos_spoiled/example_2robots")
        # The stated covariances are far too small for the closures' rotations: 0.01 rad for some 0.1.
        result = pairwise_consistent(
            graph.closures, graph.odometry, PcmSettings(noise=ClosureNoise(translation_m=0.3, rotation_rad=0.1))
        )
        outliers = {27, 38}
        accepted = {c.query.index for c in result.closures if c.survived(Stage.CONSISTENCY)}
        assert len(accepted) >= 15
        assert not accepted & outliers


@pytest.mark.slow
def test_of_a_thousand_closures_the_false_ones_are_rejected(team_maker):
    team, rng = team_maker(13, n=400, noise=1.0), np.random.default_rng(13)
    ends = rng.integers(0, 400, (1000, 2))
    closures = [
        team.closure(("alpha", int(a)), ("beta", int(b)), noise=rng)
        if n < 600
        else team.false_closure(("alpha", int(a)), ("beta", int(b)), rng)
        for n, (a, b) in enumerate(ends)
    ]
    result = pairwise_consistent(closures, team.odometry, PcmSettings())
    accepted = np.array([c.survived(Stage.CONSISTENCY) for c in result.closures])
    assert accepted[:600].mean() > 0.99
    assert not accepted[600:].any()
