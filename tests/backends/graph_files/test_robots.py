from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.graph_files.edge_table import EdgeTable
from wiclosure.backends.graph_files.robots import by_own_edges, connected

KINDS = {"odometry": np.eye(6), "loop": 4 * np.eye(6)}


def table(pairs, *, misfit=np.inf, chi_square=np.inf, kinds="odometry", may_be_false=False):
    """Edges between these pairs; other columns are one value, or one an edge."""
    n = len(pairs)
    first, second = np.array(pairs, np.int64).reshape(-1, 2).T
    matrices = np.stack([KINDS[kind] for kind in np.broadcast_to(kinds, n)]) if n else np.zeros((0, 6, 6))
    columns = (np.broadcast_to(np.asarray(value), n) for value in (may_be_false, misfit, chi_square))
    doubtful, misfits, chi_squares = columns
    return EdgeTable(first, second, np.tile(np.eye(4), (n, 1, 1)), matrices, doubtful, misfits, chi_squares)


def chain(start, stop, step=1):
    return [(k, k + step) for k in range(start, stop - step, step)]


def groups(labels):
    return [np.flatnonzero(labels == label).tolist() for label in dict.fromkeys(labels.tolist())]


def test_names_are_one_robot_where_edges_join_their_poses():
    assert groups(connected(5, table([(0, 2), (3, 4)]))) == [[0, 2], [1], [3, 4]]


def test_guesses_tell_odometry_from_the_loop_between_last_and_first_pose():
    pairs = [*chain(0, 12), *chain(12, 24), (11, 12), (3, 20)]
    misfit = [0.0] * 22 + [1e5, 1e5]
    labels = by_own_edges(24, table(pairs, misfit=misfit, chi_square=[0.0] * 22 + [900.0, 900.0]))
    assert groups(labels) == [list(range(12)), list(range(12, 24))]


def test_guesses_that_agree_with_loops_too_tell_nothing():
    pairs = [*chain(0, 24), (3, 20), (5, 9)]
    assert groups(by_own_edges(24, table(pairs, misfit=0.0, chi_square=0.0))) == [list(range(24))]


def test_matrices_tell_odometry_from_loops():
    pairs = [*chain(0, 12), *chain(12, 24), (11, 12), (3, 20)]
    labels = by_own_edges(24, table(pairs, kinds=["odometry"] * 22 + ["loop"] * 2))
    assert groups(labels) == [list(range(12)), list(range(12, 24))]


@pytest.mark.parametrize("robots", [2, 3])
def test_interleaved_numbers_are_chains(robots):
    pairs = [pair for r in range(robots) for pair in chain(r, 15 * robots, robots)] + [(3, 4), (10, 17), (20, 21)]
    labels = by_own_edges(15 * robots, table(pairs))
    assert groups(labels) == [list(range(r, 15 * robots, robots)) for r in range(robots)]


def test_numbers_that_follow_no_robot_are_one():
    """A lattice of 4 x 4 x 4."""
    places = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    near = np.abs(places[:, None] - places[None]).sum(axis=2) == 1
    assert groups(by_own_edges(64, table(np.argwhere(np.triu(near))))) == [list(range(64))]


def test_a_step_that_the_guesses_contradict_is_none():
    pairs = [*chain(0, 30), (0, 9), (20, 29)]
    chi_square = [9000.0 if pair == (14, 15) else 3.0 for pair in pairs]
    assert groups(by_own_edges(30, table(pairs, chi_square=chi_square))) == [list(range(15)), list(range(15, 30))]


def test_a_single_pose_is_part_of_the_robot_that_sees_it():
    pairs = [*chain(0, 20), (5, 20), (9, 20)]
    misfit = [0.0] * 19 + [1e5, 1e5]
    assert groups(by_own_edges(21, table(pairs, misfit=misfit, chi_square=np.square(misfit)))) == [list(range(21))]


def test_no_edges_make_as_many_robots_as_poses():
    assert len(groups(by_own_edges(3, table([])))) == 3
