from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.graph_files.edge_table import edge_table
from wiclosure.backends.graph_files.robots import by_own_edges, connected

STEP, LOOP = np.diag(np.square([0.01] * 3 + [0.05] * 3)), np.diag(np.square([0.02] * 3 + [0.1] * 3))
SIZES = st.lists(st.integers(10, 25), min_size=1, max_size=4)


class Numbered:
    """Robots whose poses are numbered in blocks, in turns, or as they come; odometry, and loops between them."""

    def __init__(self, seed, sizes, numbering="blocks", n_loops=6):
        rng = np.random.default_rng(seed)
        self.size = sum(sizes)
        if numbering == "blocks":
            places = np.split(np.arange(self.size), np.cumsum(sizes)[:-1])
        else:
            owners = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
            places = [np.flatnonzero(owners == robot) for robot in range(len(sizes))]
        self.labels = np.zeros(self.size, np.int64)
        self.poses = np.tile(np.eye(4), (self.size, 1, 1))
        steps = []
        for robot, place in enumerate(places):
            self.labels[place] = robot
            T = se3.from_yaw(rng.uniform(-3, 3), rng.normal(0, 10, 3))
            for number, step in zip(
                place, se3.exp(rng.normal(size=(len(place), 6)) * 0.2 + [0, 0, 0, 1, 0, 0]), strict=True
            ):
                self.poses[number] = T
                T = T @ step
            steps += list(zip(place[:-1].tolist(), place[1:].tolist(), strict=True))
        loops = [tuple(pair) for pair in rng.integers(0, self.size, (n_loops, 2)).tolist() if pair[0] != pair[1]]
        ends = {int(place[end]) for place in places for end in (0, -1)}
        loops = [loop for loop in loops if abs(loop[0] - loop[1]) > 1 and not ends & set(loop)]
        loops = [loop for loop in loops if loop not in steps and loop[::-1] not in steps]
        ends = np.array(steps + loops)
        T = se3.between(self.poses[ends[:, 0]], self.poses[ends[:, 1]])
        T[len(steps) :] = T[len(steps) :] @ se3.exp(rng.normal(size=(len(loops), 6)) * 0.05)
        self.ends, self.T = ends, T
        self.covariance = np.stack([STEP] * len(steps) + [LOOP] * len(loops))
        self.may_be_false = np.zeros(len(ends), bool)

    def table(self, *, guesses=True, matrices=True):
        covariance = self.covariance if matrices else np.tile(STEP, (len(self.ends), 1, 1))
        return edge_table(
            self.ends,
            self.T,
            covariance,
            self.may_be_false,
            self.poses if guesses else np.full_like(self.poses, np.nan),
        )


def same(found, expected):
    """Whether two labellings part the poses alike."""
    return np.array_equal(found[:, None] == found, expected[:, None] == expected)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), sizes=SIZES, numbering=st.sampled_from(["blocks", "turns"]))
def test_guesses_tell_robots_and_so_do_matrices(seed, sizes, numbering):
    team = Numbered(seed, sizes, numbering)
    assert same(by_own_edges(team.size, team.table(matrices=False)), team.labels)
    assert same(by_own_edges(team.size, team.table(guesses=False)), team.labels)


@pytest.mark.parametrize("numbering", ["blocks", "even and odd"])
@pytest.mark.parametrize("seed", range(5))
def test_rising_numbers_tell_robots_where_nothing_else_does(seed, numbering):
    """Closures within a robot and between both, far fewer than steps."""
    team = Numbered(seed, [30, 30], n_loops=0)
    rng = np.random.default_rng(seed)
    loops = np.stack([rng.integers(2, 10, 3), rng.integers(15, 55, 3)], axis=1)
    ends = np.concatenate([team.ends, loops])
    labels = team.labels
    if numbering != "blocks":
        number = np.concatenate([np.arange(0, 60, 2), np.arange(1, 60, 2)])
        ends, labels = number[ends], np.arange(60) % 2
    T = np.tile(np.eye(4), (len(ends), 1, 1))
    unknown = np.full((60, 4, 4), np.nan)
    table = edge_table(ends, T, np.tile(STEP, (len(ends), 1, 1)), np.zeros(len(ends), bool), unknown)
    assert same(by_own_edges(60, table), labels)


@pytest.mark.parametrize("matrices", [True, False])
def test_one_robot_with_loops_stays_one(matrices):
    team = Numbered(3, [30], n_loops=12)
    for guesses in (True, False):
        assert (by_own_edges(30, team.table(guesses=guesses, matrices=matrices)) == 0).all()


def test_a_single_pose_that_one_robot_sees_belongs_to_it():
    team = Numbered(4, [12, 12], n_loops=0)
    ends = np.concatenate([team.ends, [[5, 24]]])
    poses = np.concatenate([team.poses, [team.poses[5] @ se3.from_yaw(0.1, np.array([0.0, 3.0, 0.0]))]])
    off = se3.between(poses[5], poses[24]) @ se3.exp(np.full(6, 0.03))
    covariance = np.concatenate([team.covariance, [LOOP]])
    table = edge_table(ends, np.concatenate([team.T, [off]]), covariance, np.zeros(len(ends), bool), poses)
    assert same(by_own_edges(25, table), np.append(team.labels, 0))


def test_named_poses_are_one_robot_where_any_edges_join_them():
    team = Numbered(5, [4, 4], n_loops=0)
    assert same(connected(8, team.table()), team.labels)
    team.ends = np.concatenate([team.ends[:-1], [[0, 7]]])
    assert connected(8, team.table()).tolist() == [0, 0, 0, 0, 1, 1, 1, 0]


def test_guesses_that_contradict_odometry_itself_tell_nothing():
    """One step in ten was written from the other end and states another matrix; the guesses are all zero."""
    team = Numbered(6, [30, 40], n_loops=8)
    zeros = np.tile(np.eye(4), (team.size, 1, 1))
    covariance = team.covariance.copy()
    covariance[np.flatnonzero(np.abs(np.diff(team.ends, axis=1)[:, 0]) == 1)[::10]] = 3.0 * STEP
    table = edge_table(team.ends, team.T, covariance, np.zeros(len(team.ends), bool), zeros)
    assert same(by_own_edges(team.size, table), team.labels)
