"""Robots whose odometry jumps once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise, PcmSettings, PoseGraphSettings
from wiclosure.backends.consistency.explanation import Explanation
from wiclosure.backends.consistency.jump_places import bending_most
from wiclosure.backends.consistency.merging import settled_within
from wiclosure.backends.consistency.pcm import merge_settings, pairwise_consistent
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.least_squares.team_arrays import TeamArrays

ROBOTS = ("alpha", "beta", "gamma")
NOISE = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
T_JUMP = se3.from_yaw(0.5, np.array([8.0, -6.0, 0.0]))


def closures_of(team, rng, between=40, reach=60):
    """True ones within each robot and between each two; up to a keyframe of beta."""
    ends = [(r, r, *rng.integers(0, 60, 2)) for r in ROBOTS for _ in range(15)]
    ends += [(a, b, *rng.integers(0, 60, 2)) for a in ROBOTS for b in ROBOTS if a < b for _ in range(between)]
    return [
        team.closure((a, int(i)), (b, int(j)), noise=rng)
        for a, b, i, j in ends
        if (a != b or abs(i - j) > 5) and all(r != "beta" or n < reach for r, n in ((a, i), (b, j)))
    ]


def jumped(odometry, index, T=T_JUMP):
    """With the poses from this one on elsewhere."""
    beta = odometry["beta"]
    behind = beta.poses[index - 1] @ T @ se3.between(beta.poses[index - 1], beta.poses[index:])
    return odometry | {"beta": replace(beta, poses=np.concatenate([beta.poses[:index], behind]))}


@pytest.mark.parametrize("max_scale", [1, 10])
@pytest.mark.parametrize("seed", range(3))
def test_the_step_that_jumps_is_found_and_all_closures_stay(team_maker, seed, max_scale):
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    odometry, closures = jumped(team.odometry, 31), closures_of(team, rng)
    found = pairwise_consistent(closures, odometry, PcmSettings(noise=NOISE, max_scale=max_scale))
    assert [(jump.robot, jump.index) for jump in found.jumps] == [("beta", 31)]
    assert np.linalg.norm(found.jumps[0].error[3:]) == pytest.approx(10.0, rel=0.15)
    assert "the odometry of beta jumps by" in found.remarks[0]
    assert "keyframes 30 and 31" in found.remarks[0]
    result = optimise(found.restated(odometry), found.closures, PoseGraphSettings(noise=NOISE).scaled(found.scale))
    assert np.mean([c.live for c in result.closures]) > 0.98
    unharmed = optimise(team.odometry, closures, PoseGraphSettings(noise=NOISE))
    apart = [
        se3.between(r.trajectories["alpha"].poses[50], r.trajectories["beta"].poses[50]) for r in (result, unharmed)
    ]
    assert np.linalg.norm(se3.log(se3.between(*apart))[3:]) < 0.5


@pytest.mark.parametrize("seed", range(3))
def test_a_jump_far_from_closures_is_where_the_path_becomes_shortest(team_maker, seed):
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    odometry, closures = jumped(team.odometry, 31), closures_of(team, rng, between=12)
    apart = [c for c in closures if not any(k.robot == "beta" and 24 < k.index < 38 for k in (c.query, c.match))]
    found = pairwise_consistent(apart, odometry, PcmSettings(noise=NOISE, max_scale=10))
    assert [(jump.robot, jump.index) for jump in found.jumps] == [("beta", 31)]
    assert np.mean([c.live for c in found.closures]) > 0.95


@pytest.mark.parametrize("seed", range(3))
def test_an_even_motion_has_no_jump_whatever_false_closures_say(team_maker, seed):
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    ends = rng.integers(0, 60, (120, 2))
    false = [team.false_closure(("alpha", int(i)), ("beta", int(j)), rng) for i, j in ends]
    found = pairwise_consistent([*closures_of(team, rng), *false], team.odometry, PcmSettings(noise=NOISE))
    assert found.jumps == ()


@pytest.mark.parametrize("seed", range(3))
def test_closures_with_one_robot_alone_are_no_proof_of_a_jump(team_maker, seed):
    """They may be of a long place that looks alike."""
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    closures = closures_of(team, rng, reach=30)
    T_wrong = se3.from_yaw(0.3, np.array([12.0, 0.0, 0.0]))
    alpha, beta = (team.truth[r].poses for r in ("alpha", "beta"))
    alike = [
        team.remeasured(
            team.closure(("alpha", n), ("beta", n), noise=rng), T_query_match=se3.between(alpha[n], T_wrong @ beta[n])
        )
        for n in range(32, 60)
    ]
    found = pairwise_consistent([*closures, *alike], team.odometry, PcmSettings(noise=NOISE))
    assert found.jumps == ()
    assert not any(c.live for c in found.closures[len(closures) :])
    assert {jump.robot for jump in found.open_jumps} == {"beta"}
    assert "the map may be wrong" in found.doubts[-1]
    assert "false closures or a jump elsewhere would explain as much" in found.doubts[-1]


@pytest.mark.parametrize("true_ends", [[("alpha", "gamma"), range(36, 60, 6)], [("alpha",), range(50, 53)]])
@pytest.mark.parametrize("seed", range(3))
def test_true_closures_among_those_that_a_jump_would_explain_leave_it_open(team_maker, seed, true_ends):
    """A long place of beta looks like another to both others, and more closures say so than are true there.

    True ones of one place are enough: chance hardly makes them agree with the step of odometry.
    """
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    closures = closures_of(team, rng, reach=30)
    witnesses, at = true_ends
    true = [team.closure((r, n), ("beta", n), noise=rng) for r in witnesses for n in at]
    T_wrong = se3.from_yaw(0.3, np.array([12.0, 0.0, 0.0]))
    alike = [
        team.remeasured(c, T_query_match=se3.between(at, T_wrong @ beta))
        for r in ("alpha", "gamma")
        for n in range(32, 60, 2)
        for c, at, beta in [
            (team.closure((r, n), ("beta", n), noise=rng), team.truth[r].poses[n], team.truth["beta"].poses[n])
        ]
    ]
    found = pairwise_consistent([*closures, *true, *alike], team.odometry, PcmSettings(noise=NOISE))
    assert found.jumps == ()
    assert not any(c.live for c in found.closures[-len(alike) :])
    assert all(c.live for c in found.closures[len(closures) : -len(alike)])
    assert {jump.robot for jump in found.open_jumps} == {"beta"}


@pytest.mark.parametrize("bent", [True, False])
def test_a_step_that_bends_the_estimate_is_told_whatever_would_hold_the_parts(team_maker, bent):
    team, rng = team_maker(1, ROBOTS, noise=1.0), np.random.default_rng(1)
    odometry = jumped(team.odometry, 31) if bent else team.odometry
    sets, _ = closure_sets(closures_of(team, rng), odometry, NOISE)
    arrays = TeamArrays.of(odometry, sets, np.zeros(1000, bool))
    robots, true_poses = arrays.robots, np.concatenate([team.truth[r].poses[arrays.nodes[r]] for r in arrays.names])
    settings = merge_settings(PcmSettings(), robots.degrees)
    found = Explanation.of(robots, settings)
    all_of_them = np.ones(len(robots.loops), bool)
    settled = settled_within(robots, np.zeros(3, int), all_of_them, true_poses, np.inf)
    merged = replace(found.merged, group=np.zeros(3, int), inlier=all_of_them, settled=settled)
    told = bending_most(replace(found, merged=merged), settings)
    assert len(told) == bent
    for without, node in told:
        at = node - robots.first_nodes[1]
        assert arrays.nodes["beta"][at - 1] < 31 <= arrays.nodes["beta"][at]
        poses, step = without.merged.settled.poses, robots.odometry.subset(robots.steps_across(node))
        apart = se3.between(step.T[0], se3.between(poses[node - 1], poses[node]))
        assert np.linalg.norm(apart[:3, 3]) == pytest.approx(10.0, rel=0.15)
