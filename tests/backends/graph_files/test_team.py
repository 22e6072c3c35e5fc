"""Random teams are the same team in whatever form they are written."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise, PoseGraphSettings
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.backends.least_squares.team_arrays import TeamArrays

EXACT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)

FORMS = (
    "symbols", "labelled", "interleaved", "blocks", "one file a robot", "symbols, one file a robot", "toro3", "planar",
    "toro2", "planar, interleaved", "robot log", "planar robot log",
)  # fmt: skip


def require_same(team, written):
    """Robots, odometry with covariances, and loops are those that were written."""
    robots = list(team.odometry)
    assert [len(team.odometry[robot]) for robot in robots] == written.sizes()
    for robot, steps in zip(robots, written.steps, strict=True):
        trajectory, n = team.odometry[robot], np.arange(len(steps))
        assert trajectory.parents is None
        np.testing.assert_allclose(trajectory.relative_pose(n, n + 1), steps, atol=1e-9)
    found = {((robots.index(c.query.robot), c.query.index), (robots.index(c.match.robot), c.match.index)): c
             for c in team.closures}  # fmt: skip
    assert sorted(found) == sorted((q, m) for q, m, _ in written.loops)
    for q, m, T in written.loops:
        np.testing.assert_allclose(found[q, m].measured.T_query_match, T, atol=1e-9)
    assert not team.unusable


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10**6), robots=st.integers(2, 4))
def test_what_is_written_in_any_form_is_read_back(form, forms, tmp_path_factory, seed, robots):
    written, paths = forms.written(form, seed, tmp_path_factory.mktemp("form"), robots=robots)
    require_same(read_graphs(paths), written)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_order_of_lines_and_files_and_large_numbers_change_nothing(forms, tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    team = forms.random_team(seed, 3)
    of_robots = [rng.permutation(of_robot).tolist() for of_robot in forms.lines(team, forms.symbols)]
    paths = forms.write(tmp_path_factory.mktemp("shuffled"), of_robots, apart=True)
    require_same(read_graphs([paths[n] for n in rng.permutation(3)]), team)
    keys = forms.interleaved(team, seed)
    of_robots = forms.lines(team, lambda r, n: 10**6 + 7 * keys(r, n))
    shuffled = rng.permutation([line for of_robot in of_robots for line in of_robot]).tolist()
    require_same(read_graphs(forms.write(tmp_path_factory.mktemp("plain"), [shuffled])), team)


@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_guesses_of_a_team_in_one_frame_do_not_make_it_one_robot(forms, tmp_path_factory, seed):
    """An optimiser wrote the guesses: no edge agrees exactly, and only the numbers are left to tell."""
    team = forms.random_team(seed, 2, size=30, n_loops=8)
    starts = [np.eye(4), se3.from_yaw(0.3, np.array([3.0, 4.0, 0.0]))]
    of_robots = forms.lines(team, forms.interleaved(team, seed), starts=starts)
    rng = np.random.default_rng(seed)

    def moved(line):
        tag, key, *numbers = line.split()
        xyz = np.array(numbers[:3], float) + rng.normal(0, 0.02, 3)
        return f"{tag} {key} {forms.text(xyz)} {' '.join(numbers[3:])}" if tag.startswith("VERTEX") else line

    paths = forms.write(tmp_path_factory.mktemp("moved"), [[moved(line) for of in of_robots for line in of]])
    read = read_graphs(paths)
    assert {len(t) for t in read.odometry.values()} == {30}


def test_a_closure_from_last_to_first_pose_is_told_by_its_matrix_where_there_are_no_guesses(forms, tmp_path):
    team = forms.random_team(5, 2, size=20)
    every = [line for of_robot in forms.lines(team, forms.blocks(team)) for line in of_robot]
    read = read_graphs(forms.write(tmp_path, [[line for line in every if line.startswith("EDGE")]]))
    require_same(read, team)


def test_a_single_robot_stays_one_with_good_guesses_bad_guesses_or_none(forms, tmp_path):
    team = forms.random_team(7, 1, size=40, n_loops=30)
    (lines,) = forms.lines(team, forms.blocks(team))
    at_origin = [" ".join([*line.split()[:2], "0 0 0 0 0 0 1"]) if line[0] == "V" else line for line in lines]
    for variant in (lines, at_origin, [line for line in lines if line[0] == "E"]):
        (tmp_path / "one.g2o").write_text("\n".join(variant))
        read = read_graphs([tmp_path / "one.g2o"])
        assert [len(t) for t in read.odometry.values()] == [40]
        assert len(read.closures) == len(team.loops)


def test_branches_belong_to_their_robot_and_keep_their_steps(forms, tmp_path):
    """A robot that starts again from pose 3: a chain 0-9, and 10-14 from 3 on."""
    team = forms.random_team(9, 1, size=15, n_loops=0)
    (lines,) = forms.lines(team, forms.symbols)
    key = [str(forms.symbols(0, n)) for n in range(15)]
    moved = [line.replace(f" {key[9]} {key[10]} ", f" {key[3]} {key[10]} ") for line in lines]
    (tmp_path / "one.g2o").write_text("\n".join(moved))
    read = read_graphs([tmp_path / "one.g2o"])
    trajectory = read.odometry["a"]
    assert trajectory.parents.tolist() == [0, *range(9), 3, *range(10, 14)]
    assert trajectory.junctions.tolist() == [3]
    np.testing.assert_allclose(trajectory.relative_pose(np.array([3]), np.array([10]))[0], team.steps[0][9], atol=1e-9)
    twelve = trajectory.relative_covariance(np.array([9]), np.array([10]))[0]
    assert np.trace(twelve) > 6 * np.trace(np.diag(forms.SIGMA**2))  # six steps back to the fork, one on


def test_a_robot_of_many_own_edges_is_held_by_those_that_agree(forms, tmp_path):
    """A lattice without any chain, a fifth of whose edges are false: the tree has true ones alone."""
    rng = np.random.default_rng(4)
    places = np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    number = rng.permutation(64)
    T = se3.from_rotation_translation(np.tile(np.eye(3), (64, 1, 1)), places)
    apart = np.abs(places[:, None] - places[None]).sum(axis=2)
    i, j = np.nonzero(np.triu(np.isclose(apart, 1)))
    false = rng.random(len(i)) < 0.2
    measured = se3.between(T[i], T[j]) @ se3.exp(rng.normal(size=(len(i), 6)) * 0.02)
    measured[false] = se3.exp(rng.normal(size=(false.sum(), 6)) * [1, 1, 1, 3, 3, 3])
    key, information = [forms.symbols(0, n) for n in number], forms.full(np.full(6, 0.02))
    guesses = T @ se3.exp(rng.normal(size=(64, 6)) * 0.1)
    lines = [f"VERTEX_SE3:QUAT {key[n]} {forms.quaternion(guesses[n])}" for n in range(64)]
    lines += [
        f"EDGE_SE3:QUAT {key[a]} {key[b]} {forms.quaternion(M)} {information}"
        for a, b, M in zip(i, j, measured, strict=True)
    ]
    (tmp_path / "lattice.g2o").write_text("\n".join(lines))
    read = read_graphs([tmp_path / "lattice.g2o"])
    trajectory = read.odometry["a"]
    place = np.argsort(number)[read.indices["a"]]
    found = se3.between(np.broadcast_to(trajectory.poses[0], (64, 4, 4)), trajectory.poses)[:, :3, 3]
    assert np.linalg.norm(found - (places[place] - places[place[0]]), axis=1).max() < 1.0


def test_false_loops_in_a_recorded_lattice_are_not_taken_as_odometry(forms, data_dir, tmp_path):
    rng, paths = np.random.default_rng(0), []
    for path in sorted((data_dir / "pose_graphs/distributed_mapper/4robots").glob("[0-9].g2o")):
        lines = path.read_text().splitlines()
        keys = [line.split()[1] for line in lines if line.startswith("VERTEX")]
        information = " ".join(lines[-1].split()[10:])
        T = se3.exp(rng.normal(size=(15, 6)) * [1, 1, 1, 9, 9, 9])
        false = [
            f"EDGE_SE3:QUAT {' '.join(rng.choice(keys, 2, replace=False))} {forms.quaternion(M)} {information}"
            for M in T
        ]
        paths.append(tmp_path / path.name)
        paths[-1].write_text("\n".join([*lines, *false]))
    team = read_graphs(paths)
    left = sum(int(edge.place.rpartition(" ")[2]) > len(lines) for edge in team.edges)
    assert left == 4 * 15  # a third of each robot's own edges are false, and none holds it together
    assert not team.unusable


def test_a_branching_robot_is_estimated_from_the_edges_as_they_are_stated(data_dir):
    path = data_dir / "pose_graphs/distributed_mapper/4robots/fullGraph.g2o"
    team = read_graphs([path])
    (trajectory,) = team.odometry.values()
    assert trajectory.parents is not None
    result = optimise(team.odometry, team.closures, PoseGraphSettings(robust="none", noise=EXACT))
    graph, values = gtsam.readG2o(str(path), is3D=True)
    graph.add(gtsam.PriorFactorPose3(0, values.atPose3(0), gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)))
    best = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    between = [f for f in map(result.graph.at, range(result.graph.size())) if isinstance(f, gtsam.BetweenFactorPose3)]
    assert len(between) == 144
    assert sum(f.error(result.values) for f in between) == pytest.approx(graph.error(best), rel=1e-4)
    expected = np.stack([best.atPose3(int(key)).matrix() for key in team.keys[trajectory.robot]])
    np.testing.assert_allclose(result.trajectories[trajectory.robot].poses, expected, atol=2e-3)


def test_what_decides_on_closures_has_the_steps_of_branching_odometry(data_dir):
    team = read_graphs([data_dir / "pose_graphs/distributed_mapper/4robots/fullGraph.g2o"])
    (trajectory,) = team.odometry.values()
    sets, _ = closure_sets(team.closures, team.odometry, EXACT)
    arrays = TeamArrays.of(team.odometry, sets, np.zeros(len(team.closures), bool))
    odometry, nodes = arrays.robots.odometry, arrays.nodes[trajectory.robot]
    first, second = nodes[odometry.first], nodes[odometry.second]
    assert set(zip(first, second, strict=True)) <= set(zip(trajectory.parents[1:], range(1, 64), strict=True))
    np.testing.assert_allclose(odometry.T, trajectory.relative_pose(first, second))
    np.testing.assert_allclose(odometry.covariance, trajectory.relative_covariance(first, second), atol=1e-12)


KEPT = {
    "first of each robot": lambda robot, n: n == 0,
    "first of all": lambda robot, n: (robot, n) == (0, 0),
    "most": lambda robot, n: n % 4 != 1,
    "first robot's": lambda robot, n: robot == 0,
}


@pytest.mark.parametrize("kept", KEPT.values(), ids=KEPT)
@pytest.mark.parametrize("apart", [False, True], ids=["one file", "one file a robot"])
@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 10**6), plain=st.booleans())
def test_poses_without_a_vertex_are_where_odometry_has_them(kept, apart, forms, tmp_path_factory, seed, plain):
    team = forms.random_team(seed, 2, size=12)
    of_robots = forms.lines(team, forms.blocks(team) if plain else forms.symbols)
    for robot, lines in enumerate(of_robots):
        of_robots[robot] = [line for n, line in enumerate(lines) if not line.startswith("VERTEX") or kept(robot, n)]
    require_same(read_graphs(forms.write(tmp_path_factory.mktemp("few"), of_robots, apart=apart)), team)


def test_edges_to_a_robot_whose_file_is_missing_make_no_poses(forms, tmp_path):
    team = forms.random_team(5, 2, size=12, n_loops=12)
    between = [loop for loop in team.loops if loop[0][0] != loop[1][0]]
    for name, of_robots in (("with", forms.lines(team, forms.symbols)), ("without", forms.lines(team, forms.symbols))):
        (tmp_path / name).mkdir()
        lines = [line for line in of_robots[0] if name == "with" or not line.startswith("VERTEX")]
        alone = read_graphs(forms.write(tmp_path / name, [lines]))
        assert list(alone.odometry) == ["a"]
        assert len(alone.unusable) == sum(q[0] == 0 for q, _, _ in between) > 0


def test_a_measurement_said_again_with_another_matrix_is_one(forms, tmp_path):
    team = forms.random_team(7, 2, size=12)
    lines = [line for of_robot in forms.lines(team, forms.symbols) for line in of_robot]
    again = [" ".join([*line.split()[:-21], forms.full(3 * forms.SIGMA)]) for line in lines if line.startswith("EDGE")]
    found = read_graphs(forms.write(tmp_path, [[*lines, *again]]))
    require_same(found, team)
    assert [len(copies) for copies in found.copies] == [1] * len(team.loops)
    np.testing.assert_allclose(found.odometry["a"].step_covariances[0], np.diag(forms.SIGMA**2))
