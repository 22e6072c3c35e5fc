"""Robots whose odometry errs steadily."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise, PcmSettings, PoseGraphSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.steady_error import SteadyError

ROBOTS = ("alpha", "beta", "gamma")
NOISE = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)


def closures_of(team, rng, between=30):
    """True ones within each robot and between each two."""
    ends = [(r, r, *rng.integers(0, 60, 2)) for r in ROBOTS for _ in range(8)]
    ends += [(a, b, *rng.integers(0, 60, 2)) for a in ROBOTS for b in ROBOTS if a < b for _ in range(between)]
    return [team.closure((a, int(i)), (b, int(j)), noise=rng) for a, b, i, j in ends if a != b or abs(i - j) > 5]


def erring(odometry, robot, per_m):
    """One robot's odometry with a constant error."""
    return odometry | {robot: SteadyError(robot, -np.array(per_m)).corrected(odometry[robot])}


@pytest.mark.parametrize("per_m", [[0, 0, 0.003, 0, 0, 0], [0, 0, 0, 0.05, 0, 0]], ids=["turning", "too short"])
@pytest.mark.parametrize("seed", range(2))
def test_a_steady_error_is_found_and_corrected(team_maker, seed, per_m):
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    odometry, closures = erring(team.odometry, "beta", per_m), closures_of(team, rng)
    found = pairwise_consistent(closures, odometry, PcmSettings(noise=NOISE, max_scale=10))
    (error,) = found.steady_errors
    assert error.robot == "beta"
    np.testing.assert_allclose(error.per_m, per_m, atol=0.2 * np.max(per_m))
    assert found.jumps == ()
    assert found.doubts == ()
    assert any("the odometry of beta errs steadily" in remark for remark in found.remarks)
    result = optimise(found.restated(odometry), found.closures, PoseGraphSettings(noise=NOISE).scaled(found.scale))
    assert np.mean([c.live for c in result.closures]) > 0.98
    unharmed = optimise(team.odometry, closures, PoseGraphSettings(noise=NOISE))
    apart = [
        se3.between(r.trajectories["alpha"].poses[50], r.trajectories["beta"].poses[50]) for r in (result, unharmed)
    ]
    assert np.linalg.norm(se3.log(se3.between(*apart))[3:]) < 0.3


@pytest.mark.parametrize("seed", range(4))
def test_odometry_that_errs_as_stated_has_none(team_maker, seed):
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    closures = closures_of(team, rng)
    false = [
        team.false_closure((ROBOTS[n % 3], int(i)), (ROBOTS[(n + 1) % 3], int(j)), rng)
        for n, (i, j) in enumerate(rng.integers(0, 60, (60, 2)))
    ]
    found = pairwise_consistent([*closures, *false], team.odometry, PcmSettings(noise=NOISE, max_scale=10))
    assert found.steady_errors == ()
    assert found.doubts == ()


def test_odometry_that_branches_is_left_as_it_is(team_maker):
    team, rng = team_maker(0, ROBOTS, noise=1.0), np.random.default_rng(0)
    odometry = erring(team.odometry, "beta", [0, 0, 0.01, 0, 0, 0])
    beta = odometry["beta"]
    stated = beta.relative_covariance(np.arange(59), np.arange(1, 60))
    odometry["beta"] = replace(beta, step_covariances=stated, parents=np.maximum(np.arange(60) - 1, 0))
    found = pairwise_consistent(closures_of(team, rng), odometry, PcmSettings(noise=NOISE))
    assert found.steady_errors == ()


@pytest.mark.parametrize(("share", "believed"), [(0.2, True), (0.6, False)], ids=["a fifth", "most"])
def test_an_error_as_large_as_half_of_the_motion_is_a_doubt(team_maker, share, believed):
    """Where neighbouring places look alike, closures say that a robot hardly moved."""
    team, rng = team_maker(0, ROBOTS, noise=1.0), np.random.default_rng(0)
    odometry = erring(team.odometry, "beta", [0, 0, 0, share, 0, 0])
    found = pairwise_consistent(closures_of(team, rng), odometry, PcmSettings(noise=NOISE, max_scale=10))
    assert [error.robot for error in found.steady_errors] == ["beta"] * believed
    assert [error.robot for error in found.open_steady_errors] == ["beta"] * (not believed)
    assert any("the odometry of beta errs by" in said for said in found.doubts) != believed
