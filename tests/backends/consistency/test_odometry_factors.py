"""Robots of which one errs more than it states."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.config import ClosureNoise, PcmSettings, PoseGraphSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.backends.estimate.pose_graph import optimise

ROBOTS = ("alpha", "beta", "gamma")
SETTINGS = PcmSettings(noise=ClosureNoise(translation_m=1e-6, rotation_rad=1e-6), max_scale=10)
STATED = PoseGraphSettings(noise=SETTINGS.noise)


def closures_of(team, rng, own=25, between=15):
    """True ones within each robot and between each two."""
    pairs = [(r, r, own) for r in ROBOTS] + [(a, b, between) for a in ROBOTS for b in ROBOTS if a < b]
    ends = [(a, b, *rng.integers(0, 60, 2)) for a, b, count in pairs for _ in range(count)]
    return [team.closure((a, int(i)), (b, int(j)), noise=rng) for a, b, i, j in ends if a != b or abs(i - j) > 5]


@pytest.mark.parametrize("seed", range(3))
def test_a_robot_that_overstates_its_odometry_keeps_its_closures(team_maker, seed):
    team, rng = team_maker(seed, ROBOTS, noise=2.0), np.random.default_rng(seed)
    odometry = {r: t.loosened(2.0) for r, t in team.odometry.items()}
    odometry["beta"] = team.odometry["beta"].loosened(0.25)
    closures = closures_of(team, rng)
    found = pairwise_consistent(closures, odometry, SETTINGS)
    assert list(found.odometry_factors) == ["beta"]
    assert 3 < found.odometry_factors["beta"] < 10
    assert "the odometry of beta errs more than it states" in found.remarks[0]
    result = optimise(found.restated(odometry), found.closures, STATED.scaled(found.scale))
    assert np.mean([c.live for c in result.closures]) > 0.98
    assert found.restated(odometry)["alpha"] is odometry["alpha"]


def test_what_all_measurements_overstate_is_one_factor_for_all(team_maker):
    team, rng = team_maker(3, ROBOTS, noise=1.0), np.random.default_rng(3)
    odometry = {r: t.loosened(1 / 4) for r, t in team.odometry.items()}
    closures = [team.remeasured(c, covariance=c.measured.covariance / 16) for c in closures_of(team, rng)]
    found = pairwise_consistent(closures, odometry, SETTINGS)
    assert found.odometry_factors == {}
    assert 2.5 < found.scale < 6


@pytest.mark.parametrize("seed", range(3))
def test_false_loops_within_a_robot_are_no_sign_of_bad_odometry(team_maker, seed):
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    closures = closures_of(team, rng)
    ends = rng.integers(0, 60, (10, 2))
    false = [team.false_closure(("beta", int(i)), ("beta", int(j)), rng) for i, j in ends if abs(i - j) > 5]
    found = pairwise_consistent([*closures, *false], team.odometry, SETTINGS)
    assert found.odometry_factors == {}
    kept = np.array([c.live for c in found.closures])
    assert kept[: len(closures)].mean() > 0.98
    assert not kept[len(closures) :].any()
