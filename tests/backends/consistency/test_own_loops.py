"""Robots that know their own paths badly: nodes of a cube with noisy rotations, as public benchmarks have them."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise, PcmSettings
from wiclosure.backends.consistency.own_loops import OwnLoops, by_all_own_loops
from wiclosure.backends.consistency.pcm import merge_settings, pairwise_consistent
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.types import Closure, KeyframeId, Trajectory

EXACT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
SIGMA = np.repeat([0.2, 0.1], 3)
SIDE, ROBOTS = 5, 3


def noisy_cube(seed, stated):
    """Odometry of three robots that walk a cube lane by lane, their closures, 30 % of them false, and which are true.

    Sigmas are stated so many times as large as they are.
    """
    rng = np.random.default_rng(seed)
    lane = [(x if (y + z) % 2 == 0 else SIDE - 1 - x, y, z) for z, y, x in product(range(SIDE), repeat=3)]
    cells = np.array([(x, y if z % 2 == 0 else SIDE - 1 - y, z) for x, y, z in lane], float)
    robot = np.arange(len(cells)) * ROBOTS // len(cells)
    truth = se3.from_rotation_translation(Rotation.random(len(cells), rng=rng).as_matrix(), cells)
    first, second = np.nonzero(np.triu(np.linalg.norm(cells[:, None] - cells, axis=2) < 1.1, 1))
    T = se3.between(truth[first], truth[second]) @ se3.exp(rng.normal(size=(len(first), 6)) * SIGMA)
    covariance, odometry = np.diag((stated * SIGMA) ** 2), {}
    is_step = (second == first + 1) & (robot[first] == robot[second])
    for number in range(ROBOTS):
        poses = [np.eye(4)]
        for step in np.flatnonzero(is_step & (robot[first] == number)):
            poses.append(poses[-1] @ T[step])
        of_steps = np.tile(covariance, (len(poses) - 1, 1, 1))
        name, stamps_ns = f"r{number}", np.arange(len(poses)) * 10**9
        odometry[name] = Trajectory(name, stamps_ns, np.stack(poses), step_covariances=of_steps)
    loops = rng.permutation(np.flatnonzero(~is_step))
    ends = [*zip(first[loops], second[loops], T[loops], strict=True)]
    while len(ends) < round(len(loops) / 0.7):
        i, j = rng.integers(0, len(cells), 2)
        if robot[i] != robot[j]:
            wrong = Rotation.random(1, rng=rng).as_matrix(), rng.normal(0, 1, (1, 3))
            ends.append((i, j, se3.from_rotation_translation(*wrong)[0]))
    start = np.searchsorted(robot, np.arange(ROBOTS))
    keys = [[KeyframeId(f"r{robot[n]}", int(n - start[robot[n]])) for n in (i, j)] for i, j, _ in ends]
    closures = [Closure.from_measurement(*of, T_ij, covariance) for of, (_, _, T_ij) in zip(keys, ends, strict=True)]
    return odometry, closures, np.arange(len(ends)) < len(loops)


@pytest.mark.parametrize("seed", [1, 5, 10])
def test_sigmas_stated_too_small_are_told_on_a_noisy_graph(seed):
    """Under a third of the sigma few loops fit, by chance; and odometry may lead to a wrong minimum (10)."""
    odometry, closures, true = noisy_cube(seed, 0.3)
    result = pairwise_consistent(closures, odometry, PcmSettings(noise=EXACT, max_scale=10.0))
    kept = np.array([c.live for c in result.closures])
    assert result.scale == pytest.approx(1 / 0.3, rel=0.15)
    assert kept[true].all()
    assert not kept[~true].any()


@pytest.mark.parametrize("seed", [0, 2, 10, 20])
def test_a_wrong_minimum_that_odometry_leads_to_is_left(seed):
    """Residuals are as stated: a robot in a wrong minimum has several times as large ones."""
    odometry, closures, true = noisy_cube(seed, 1.0)
    sets, _ = closure_sets([c for c, is_true in zip(closures, true, strict=True) if is_true], odometry, EXACT)
    robots = TeamArrays.of(odometry, sets, np.zeros(len(closures), bool)).robots
    settled = by_all_own_loops(robots)
    assert np.nanmean(settled.redundant) == pytest.approx(6.0, rel=0.2)


@pytest.mark.parametrize("false", [0, 60])
def test_where_most_own_loops_are_false_those_that_agree_are_kept_alone(team_maker, false):
    """Nothing is estimated from all of them where some stand alone against odometry."""
    rng, team = np.random.default_rng(7), team_maker(7, ("alpha",), noise=1.0)
    ends = np.stack([rng.integers(0, 25, 20), rng.integers(30, 60, 20)], axis=1).tolist()
    closures = [team.closure(("alpha", i), ("alpha", j), noise=rng) for i, j in ends]
    for i, j in np.stack([rng.integers(0, 25, false), rng.integers(30, 60, false)], axis=1).tolist():
        closures.append(team.false_closure(("alpha", i), ("alpha", j), rng))
    sets, _ = closure_sets(closures, team.odometry, EXACT)
    arrays = TeamArrays.of(team.odometry, sets, np.zeros(len(closures), bool))
    own = OwnLoops(arrays.robots, merge_settings(PcmSettings(noise=EXACT)))
    assert (own.all is None) == (false > 0)
    np.testing.assert_array_equal(own.inliers(1.0).inlier, arrays.rows < 20)
