from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.consistency.joining import connect, joined_groups
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled
from wiclosure.backends.sets.alignment import ClosureComparison
from wiclosure.backends.sets.candidate_sets import CandidateSet
from wiclosure.backends.sets.claims import Claims

SIGMA = np.repeat([0.01, 0.1], 3)
LIMIT = float(chi2.ppf(0.99, 6))
NODES = 4  # of each robot


class Four:
    """Four robots with known poses in one world, each estimated in a frame of its own."""

    def __init__(self, seed=0):
        self.rng = np.random.default_rng(seed)
        self.T_world_group = se3.from_yaw(self.rng.uniform(-3, 3, 4), self.rng.normal(0, 20, (4, 3)))
        self.robot = np.repeat(np.arange(4), NODES)
        self.truth = se3.from_yaw(self.rng.uniform(-3, 3, 4 * NODES), self.rng.normal(0, 20, (4 * NODES, 3)))
        poses = se3.between(self.T_world_group[self.robot], self.truth)
        none = Edges.stacked([])
        self.robots = Robots(self.robot, poses, none, none, np.zeros(0, bool), np.zeros(4 * NODES), np.zeros(4), 1.0)
        self.settled = Settled(poses, np.zeros((4 * NODES, 6, 100)), np.zeros(0, bool), np.zeros(0), np.zeros(0))
        self.row = 0

    def candidate(self, a, b, size, shift=None):
        """A set of exact closures with the next rows; as if b lay elsewhere by `shift`."""
        T_a, T_b = (self.settled.poses[NODES * g + self.rng.integers(0, NODES, size)] for g in (a, b))
        T_a_b = se3.between(self.T_world_group[a], self.T_world_group[b]) @ (np.eye(4) if shift is None else shift)
        still = np.zeros((size, 6, 100))
        covariance = np.tile(np.diag(SIGMA**2), (size, 1, 1))
        comparison = ClosureComparison.of(
            Claims(T_a, T_b, se3.between(T_a, T_a_b @ T_b), covariance, still, still), LIMIT
        )
        rows = np.arange(self.row, self.row + size)
        self.row += size
        return CandidateSet(a, b, rows, comparison.consistent_sets(LIMIT)[0], comparison)

    def joined(self, *holding):
        group, poses, joining = joined_groups(self.robots, np.arange(4), self.settled, holding, LIMIT)
        return group, poses, np.concatenate([c.rows for c in joining])


def assert_rigid(four, poses, members):
    """Up to the frame of the first, the poses of the members are the true ones."""
    nodes = np.flatnonzero(np.isin(four.robot, members))
    expected = se3.between(four.T_world_group[min(members)], four.truth[nodes])
    np.testing.assert_allclose(poses[nodes], expected, atol=1e-9)


def test_a_chain_joins_its_robots_and_leaves_the_other_alone():
    four = Four()
    group, poses, rows = four.joined(four.candidate(0, 1, 3), four.candidate(1, 3, 2))
    assert group.tolist() == [0, 0, 2, 0]
    assert_rigid(four, poses, [0, 1, 3])
    assert_rigid(four, poses, [2])
    assert sorted(rows.tolist()) == [0, 1, 2, 3, 4]


def test_joins_are_followed_against_their_direction():
    """The group of 1 and 3 is reached from 1 over 2's set, which runs the other way."""
    four = Four(1)
    group, poses, _ = four.joined(four.candidate(0, 3, 3), four.candidate(1, 3, 3), four.candidate(1, 2, 3))
    assert group.tolist() == [0, 0, 0, 0]
    assert_rigid(four, poses, [0, 1, 2, 3])


def test_two_islands_stay_apart():
    four = Four(2)
    group, poses, _ = four.joined(four.candidate(0, 2, 2), four.candidate(1, 3, 2))
    assert group.tolist() == [0, 1, 0, 1]
    assert_rigid(four, poses, [0, 2])
    assert_rigid(four, poses, [1, 3])


@pytest.mark.parametrize("wrong", [False, True])
def test_a_set_off_the_tree_counts_if_it_agrees_with_the_others(wrong):
    four = Four(3)
    strong = four.candidate(0, 1, 5), four.candidate(1, 2, 5)
    shift = se3.from_yaw(0.4, np.array([20.0, 5.0, 0.0])) if wrong else None
    group, poses, rows = four.joined(*strong, four.candidate(0, 2, 2, shift))
    assert group.tolist() == [0, 0, 0, 3]
    assert_rigid(four, poses, [0, 1, 2])
    assert sorted(rows.tolist()) == list(range(10 if wrong else 12))


def test_of_two_sets_of_one_pair_the_better_supported_joins():
    four = Four(4)
    true, false = four.candidate(0, 1, 3), four.candidate(0, 1, 5, se3.from_yaw(0.4, np.array([20.0, 5.0, 0.0])))
    true.support = 5.0
    _, poses, rows = four.joined(false, true)
    assert_rigid(four, poses, [0, 1])
    assert rows.tolist() == [0, 1, 2]


def test_groups_stay_joined_by_the_sets_that_stand():
    four = Four(5)
    chain = four.candidate(0, 1, 3), four.candidate(1, 2, 3), four.candidate(0, 2, 3)
    before, after = np.arange(4), np.array([0, 0, 0, 3])
    assert connect(chain, before, after)
    assert connect(chain[1:], before, after)
    assert not connect(chain[:1], before, after)
