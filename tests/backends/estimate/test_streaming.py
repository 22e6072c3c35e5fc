from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise, PcmSettings, PoseGraphSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.estimate.streaming import StreamingBackEnd
from wiclosure.types import Closure, KeyframeId, Stage, Trajectory

ROBOTS = ("alpha", "beta", "gamma")


def false_closures(team, n, rng, a="alpha", b="beta"):
    return [team.false_closure((a, int(i)), (b, int(j)), rng) for i, j in rng.integers(0, 60, (n, 2))]


def decisions(result):
    return [c.rejected_at for c in result.closures]


@pytest.mark.parametrize("seed", range(2))
def test_closure_by_closure_comes_to_the_batch_estimate(team_maker, seed):
    team, rng = team_maker(seed, ROBOTS, noise=1.0), np.random.default_rng(seed)
    closures = team.random_closures(12, rng, noise=rng) + team.random_closures(12, rng, "beta", "gamma", noise=rng)
    closures += false_closures(team, 6, rng) + team.random_closures(4, rng, "gamma", "gamma", noise=rng)
    closures = [closures[n] for n in rng.permutation(len(closures))]
    stream = StreamingBackEnd(team.odometry, PcmSettings(), PoseGraphSettings())
    for closure in closures:
        stream.add([closure])
    checked = pairwise_consistent(closures, team.odometry, PcmSettings())
    batch = optimise(team.odometry, checked.closures, PoseGraphSettings())
    assert decisions(stream.result()) == decisions(batch)
    for robot in batch.components[0]:
        np.testing.assert_allclose(stream.poses(robot), batch.trajectories[robot].poses, atol=0.02)
        np.testing.assert_allclose(
            stream.result().trajectories[robot].poses, batch.trajectories[robot].poses, atol=1e-6
        )


def test_keyframes_may_arrive_between_closures(team_maker):
    team, rng = team_maker(5, ("alpha", "beta"), noise=1.0), np.random.default_rng(5)
    until = [{r: t.subset(np.arange(n)) for r, t in team.odometry.items()} for n in (20, 40, 60)]
    parts = [team.random_closures(6, rng, limit=n, noise=rng) for n in (20, 40, 60)]
    stream = StreamingBackEnd(until[0], PcmSettings(), PoseGraphSettings())
    for odometry, closures in zip(until, parts, strict=True):
        stream.extend(odometry)
        for closure in closures:
            stream.add([closure])
    closures = [closure for part in parts for closure in part]
    checked = pairwise_consistent(closures, team.odometry, PcmSettings())
    batch = optimise(team.odometry, checked.closures, PoseGraphSettings())
    for robot in team.odometry:
        np.testing.assert_allclose(stream.poses(robot), batch.trajectories[robot].poses, atol=0.02)


def test_an_early_mistake_heals(team_maker):
    """Three false closures that agree come first; the true ones outvote them later."""
    team, rng = team_maker(6, ("alpha", "beta"), noise=1.0), np.random.default_rng(6)
    mirror = se3.from_yaw(0.5, np.array([30.0, 0.0, 0.0]))
    poses = team.truth["alpha"].poses, mirror @ team.truth["beta"].poses
    false = [
        team.remeasured(team.closure(("alpha", i), ("beta", j)), T_query_match=se3.between(poses[0][i], poses[1][j]))
        for i, j in ((5, 50), (30, 30), (50, 5))
    ]
    stream = StreamingBackEnd(team.odometry, PcmSettings(), PoseGraphSettings())
    stream.add(false)
    assert decisions(stream.result()) == [None] * 3
    for closure in team.random_closures(10, rng, noise=rng):
        stream.add([closure])
    assert decisions(stream.result())[:3] == [Stage.CONSISTENCY] * 3
    truth = se3.inverse(team.truth["alpha"].poses[0]) @ team.truth["beta"].poses
    assert np.linalg.norm(stream.poses("beta")[:, :3, 3] - truth[:, :3, 3], axis=1).max() < 1.5


def test_a_late_false_closure_does_no_harm(team_maker):
    team, rng = team_maker(7, ("alpha", "beta"), noise=1.0), np.random.default_rng(7)
    stream = StreamingBackEnd(team.odometry, PcmSettings(), PoseGraphSettings())
    stream.add(team.random_closures(10, rng, noise=rng))
    before = stream.poses("beta")
    for closure in false_closures(team, 5, rng):
        stream.add([closure])
    np.testing.assert_allclose(stream.poses("beta"), before, atol=1e-6)


def test_without_pcm_the_estimate_alone_switches_false_closures_off(team_maker):
    team, rng = team_maker(8, ("alpha", "beta"), noise=1.0), np.random.default_rng(8)
    stream = StreamingBackEnd(team.odometry, PcmSettings(enabled=False), PoseGraphSettings())
    stream.add(team.random_closures(10, rng, noise=rng))
    before = stream.poses("beta")
    for closure in false_closures(team, 3, rng):
        stream.add([closure])
    assert np.abs(stream.poses("beta") - before).max() < 0.05


@pytest.mark.parametrize(("lift_m", "kept"), [(0.0, False), (1.0, True)])
def test_planar_closures_are_switched_off_by_three_degrees_of_freedom(lift_m, kept):
    """One that is 4.4 sigma off: too far for three degrees of freedom, not for six."""
    x_m = np.arange(30.0)
    poses = se3.from_yaw(0.0 * x_m, np.stack([x_m, 0.0 * x_m, lift_m * (x_m > 15)], axis=1))
    steps = np.tile(1e-6 * np.eye(6), (29, 1, 1))
    stamps_ns = np.arange(30, dtype=np.int64) * 10**9
    odometry = {name: Trajectory(name, stamps_ns, poses, step_covariances=steps) for name in ("a", "b")}
    closures = [
        Closure.from_measurement(KeyframeId("a", n), KeyframeId("b", n), np.eye(4), 0.01 * np.eye(6))
        for n in range(0, 30, 3)
    ]
    off = se3.from_yaw(0.0, np.array([0.0, 0.485, 0.0]))
    closures.append(Closure.from_measurement(KeyframeId("a", 14), KeyframeId("b", 14), off, 0.01 * np.eye(6)))
    exact = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
    stream = StreamingBackEnd(odometry, PcmSettings(enabled=False), PoseGraphSettings(noise=exact))
    for closure in closures:
        stream.add([closure])
    decided = stream.result().closures
    assert [c.survived(Stage.ESTIMATE) for c in decided] == [True] * 10 + [kept]
    moved = stream.poses("b")[14, 1, 3]
    assert (abs(moved) > 0.01) == kept
