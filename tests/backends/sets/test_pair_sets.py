from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled
from wiclosure.backends.sets.candidate_sets import LEAST_COVERAGE
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import claims_between, pairs_of_groups, places_of_groups, sets_between, stands

SIGMA = np.repeat([0.01, 0.05], 3)
SETTINGS = MergeSettings(agree_limit=float(chi2.ppf(0.99, 6)))
NODES = 40
STEP_M = 1.0
ELSEWHERE = se3.from_yaw(0.3, np.array([30.0, 4.0, 0.0]))


def team(ends, *, robots=2, seed=0, shift=(), predicted=()):
    """Robots on winding paths, their closures between the nodes `(robot, node, robot, node)`, the estimate, the truth.

    The closures `shift` are as if their second robot lay elsewhere.
    """
    rng = np.random.default_rng(seed)
    robot, truth = np.repeat(np.arange(robots), NODES), []
    for _ in range(robots):
        pose = se3.from_yaw(rng.uniform(-3, 3), np.array([*rng.uniform(-15, 15, 2), 0.0]))
        for turn in rng.normal(0.05, 0.1, NODES):
            truth.append(pose)
            pose = pose @ se3.from_yaw(turn, np.array([STEP_M, 0.0, 0.0]))
    truth = np.stack(truth)
    poses = se3.between(truth[NODES * robot], truth)
    ends = np.array(ends, int).reshape(-1, 4)
    first, second = NODES * ends[:, 0] + ends[:, 1], NODES * ends[:, 2] + ends[:, 3]
    moved = np.where(np.isin(np.arange(len(ends)), shift)[:, None, None], ELSEWHERE, np.eye(4))
    T = se3.between(truth[first], moved @ truth[second]) @ se3.exp(0.3 * rng.normal(size=(len(ends), 6)) * SIGMA)
    loops = Edges(first, second, T, np.tile(np.diag(SIGMA**2), (len(ends), 1, 1)))
    told = np.isin(np.arange(len(ends)), predicted)
    still = np.zeros((len(truth), 6, 100))
    estimate = Settled(poses, still, np.zeros(len(ends), bool), np.full(len(ends), np.nan), np.zeros(0))
    along_m, length_m = np.tile(STEP_M * np.arange(NODES), robots), np.full(robots, STEP_M * (NODES - 1))
    return Robots(robot, poses, Edges.stacked([]), loops, told, along_m, length_m, STEP_M), estimate, truth


def sets(ends, settings=SETTINGS, **changes):
    robots, estimate, _ = team(ends, **changes)
    group = np.arange(2)
    return sets_between(robots, np.arange(len(robots.loops)), group, estimate, settings)


def spread(count, seed=0):
    return [(0, int(i), 1, int(j)) for i, j in np.random.default_rng(seed).integers(0, NODES, (count, 2))]


def test_closures_are_split_by_pairs_of_groups():
    ends = [(0, 1, 2, 1), (1, 1, 0, 1), (1, 5, 1, 9), (2, 3, 0, 3), (0, 2, 1, 2), (2, 7, 1, 7)]
    robots, _, _ = team(ends, robots=3)
    assert [rows.tolist() for rows in pairs_of_groups(robots, np.arange(3))] == [[1, 4], [0, 3], [5]]
    assert [rows.tolist() for rows in pairs_of_groups(robots, np.array([0, 0, 2]))] == [[0, 3, 5]]
    assert pairs_of_groups(robots, np.array([0, 0, 0])) == []


def test_claims_run_from_the_lower_to_the_higher_group_whichever_way_closures_do():
    robots, estimate, truth = team([(0, 3, 1, 30), (1, 12, 0, 25)])
    claims = claims_between(robots, np.arange(2), np.arange(2), estimate)
    T_0_1 = se3.between(truth[0], truth[NODES])
    np.testing.assert_allclose(claims.T_A_a, estimate.poses[[3, 25]])
    np.testing.assert_allclose(claims.T_B_b, estimate.poses[[NODES + 30, NODES + 12]])
    error = se3.log(se3.between(T_0_1, claims.frames))
    assert (np.einsum("ni,nij,nj->n", error, np.linalg.inv(claims.noise), error) < SETTINGS.agree_limit).all()


def test_closures_all_over_both_paths_leave_no_doubt():
    (found,) = sets(spread(8))
    assert (found.a, found.b, len(found), found.objection) == (0, 1, 8, "")
    assert found.holds


def test_closures_of_one_place_are_doubted_unless_predicted():
    """The same wrong pose from keyframes next to each other: they agree with each other."""
    ends = [(0, 10 + n, 1, 20 + n) for n in range(4)]
    (alone,), (told,) = sets(ends, shift=range(4)), sets(ends, shift=range(4), predicted=[2])
    assert len(alone) == len(told) == 4
    assert alone.coverage < LEAST_COVERAGE
    assert "look-alike" in alone.objection
    assert told.objection == ""


def test_how_far_one_view_reaches_is_for_the_user_to_say():
    positions = team([])[2][:, :3, 3].reshape(2, NODES, 3)
    apart = np.linalg.norm(positions[0, :-6, None] - positions[1, None, :-6], axis=2)
    i, j = np.unravel_index(np.argmin(apart), apart.shape)
    ends = [(0, i + n, 1, j + n) for n in range(6)]
    doubted = [bool(sets(ends, replace(SETTINGS, view_steps=reach))[0].objection) for reach in (10.0, 2.0)]
    assert doubted == [True, False]


@pytest.mark.parametrize(("shifted", "doubted"), [(6, [True, True]), (3, [False, True])])
def test_a_set_that_contradicts_another_leaves_both_open_if_it_is_as_large(shifted, doubted):
    found = sets(spread(7 + shifted, 4), shift=range(7, 7 + shifted))
    assert [len(c) for c in found] == [7, shifted]
    assert [bool(c.objection) for c in found] == doubted
    assert ("ambiguous" if all(doubted) else "inconsistent with the 7 closures") in found[1].objection


def test_a_single_closure_cannot_be_checked():
    (found,) = sets(spread(1))
    assert found.objection == "a single closure cannot be checked"


def test_rows_are_those_of_all_closures():
    robots, estimate, _ = team([(0, 1, 0, 30), *spread(5)])
    (found,) = sets_between(robots, np.arange(1, 6), np.arange(2), estimate, SETTINGS)
    assert found.rows.tolist() == [1, 2, 3, 4, 5]


def test_places_are_the_nodes_of_a_group():
    robots, estimate, _ = team([], robots=3)
    places = places_of_groups(robots, np.array([0, 1, 0]), estimate)
    assert {g: len(poses) for g, (poses, _) in places.items()} == {0: 2 * NODES, 1: NODES}
    np.testing.assert_array_equal(places[1][0], estimate.poses[NODES : 2 * NODES])


def test_neighbouring_closures_count_as_one_place():
    """However many they are: they agree with each other for one reason."""
    (beside,) = sets([(0, 10 + n, 1, 20 + n) for n in range(6)])
    (apart,) = sets([(0, 12 * n, 1, 12 * n) for n in range(3)])
    (one_passes,) = sets([(0, 5, 1, 12 * n) for n in range(3)])
    assert (beside.places, apart.places, one_passes.places) == (1, 3, 3)
    assert beside.weight < apart.weight


@pytest.mark.parametrize(("left", "holds"), [(8, True), (6, True), (1, False), (0, False)])
def test_what_an_estimate_leaves_of_a_set_is_judged_as_a_set(left, holds):
    robots, estimate, _ = team(spread(8))
    (found,) = sets_between(robots, np.arange(8), np.arange(2), estimate, SETTINGS)
    assert stands(robots, found, np.arange(8) < left, np.arange(2), estimate, SETTINGS) == holds


def test_three_closures_at_any_places_are_no_single_place_in_all_but_one_of_two_hundred():
    """Long closures: views reach as far, so that only the share of the paths that they span tells."""
    refused, rng = 0, np.random.default_rng(1)
    for _ in range(400):
        robots, estimate, _ = team([(0, int(i), 1, int(j)) for i, j in rng.integers(0, NODES, (3, 2))])
        refused += any(
            "look-alike" in c.objection for c in sets_between(robots, np.arange(3), np.arange(2), estimate, SETTINGS)
        )
    assert refused <= 8
