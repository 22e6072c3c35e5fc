"""Directions up and positions in the pose graph: less drift, one frame, and wrong ones outvoted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.config import PoseGraphSettings
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.estimate.streaming import StreamingBackEnd
from wiclosure.backends.factor_graph.earth_factors import Ground, weights_of_fixes, weights_of_up
from wiclosure.backends.graph_files.g2o_writer import write_g2o
from wiclosure.drift import DriftModel
from wiclosure.types import Closure, EarthMeasurements, KeyframeId, PositionFixes, Trajectory, UpDirections

SIGMA_RAD = np.radians(0.5)
COVARIANCE = np.diag(np.repeat([0.005**2, 0.03**2], 3))


def true_poses(count=300, start=(0.0, 0.0)):
    """A drive of 2 m a pose with bends, level."""
    yaw = 0.5 * np.sin(np.arange(count) / 40.0)
    steps = 2.0 * np.column_stack([np.cos(yaw), np.sin(yaw), 0.02 * np.cos(np.arange(count) / 30.0)])
    return se3.from_yaw(yaw, np.array([*start, 0.0]) + np.cumsum(steps, axis=0))


def drifted(robot, poses, seed):
    """Odometry in its own frame, upright at its start."""
    rng, drift = np.random.default_rng(seed), DriftModel(rotation_walk=0.002)
    steps = se3.between(poses[:-1], poses[1:])
    sigma = np.repeat([0.002 * np.sqrt(2.0), 0.046 * np.sqrt(2.0)], 3)
    chain = [np.eye(4)]
    for step in steps @ se3.exp(sigma * rng.normal(size=(len(steps), 6))):
        chain.append(chain[-1] @ step)
    return Trajectory(robot, np.arange(len(poses), dtype=np.int64) * 10**9, np.stack(chain), drift)


def up_of(poses, every=5, seed=0):
    rows = np.arange(0, len(poses), every)
    noise = Rotation.from_rotvec(np.random.default_rng(seed).normal(0, SIGMA_RAD, (len(rows), 3))).as_matrix()
    return UpDirections(rows, np.einsum("nij,nj->ni", noise, poses[rows, 2, :3]), np.full(len(rows), SIGMA_RAD))


def fixes_of(poses, every=10, sigma_m=1.0, seed=0, T_enu_world=None):
    rows = np.arange(0, len(poses), every)
    antenna = np.tile([0.5, -0.2, 0.8], (len(rows), 1))
    at = (np.eye(4) if T_enu_world is None else T_enu_world) @ poses[rows]
    position = np.einsum("nij,nj->ni", at[:, :3, :3], antenna) + at[:, :3, 3]
    noise = np.random.default_rng(seed).normal(0, sigma_m, position.shape)
    return PositionFixes(rows, position + noise, np.full(position.shape, sigma_m), antenna)


@pytest.fixture(scope="module")
def pair():
    """Two robots that meet at the start of the one and the end of the other: truth, odometry, closures."""
    truth = {"alpha": true_poses(), "beta": true_poses(250, start=(560.0, 0.0))}
    odometry = {robot: drifted(robot, poses, seed) for seed, (robot, poses) in enumerate(truth.items())}
    rng, closures = np.random.default_rng(9), []
    for i, j in zip(range(280, 300, 4), range(0, 20, 4), strict=True):
        T = se3.between(truth["alpha"][i], truth["beta"][j]) @ se3.exp(
            np.sqrt(np.diag(COVARIANCE)) * rng.normal(size=6)
        )
        closures.append(Closure.from_measurement(KeyframeId("alpha", i), KeyframeId("beta", j), T, COVARIANCE))
    return truth, odometry, closures


def heights_off(result, truth):
    """Root mean square of heights against truth, from alpha's first pose on."""
    off = [
        result.trajectories[r].positions[:, 2] - result.trajectories["alpha"].positions[0, 2]
        - (truth[r][:, 2, 3] - truth["alpha"][0, 2, 3])
        for r in truth
    ]  # fmt: skip
    return np.sqrt(np.mean(np.concatenate(off) ** 2))


def earth_of(truth):
    return EarthMeasurements({robot: up_of(poses) for robot, poses in truth.items()})


def test_gravity_holds_heights(pair):
    truth, odometry, closures = pair
    plain = optimise(odometry, closures)
    upright = optimise(odometry, closures, earth=earth_of(truth))
    assert upright.components == (("alpha", "beta"),)
    assert heights_off(upright, truth) < 0.4 * heights_off(plain, truth)
    tilt = upright.trajectories["beta"].poses[:, 2, 2]
    assert np.degrees(np.arccos(tilt.min())) < 1.0


def test_wrong_directions_are_outvoted(pair):
    truth, odometry, closures = pair
    earth = earth_of(truth)
    up = earth.up["beta"]
    wrong = np.arange(3, len(up), 6)
    turned = up.up_body.copy()
    turned[wrong] = Rotation.from_euler("x", 15, degrees=True).apply(turned[wrong])
    spoiled = EarthMeasurements(dict(earth.up) | {"beta": replace(up, up_body=turned)})
    clean, result = optimise(odometry, closures, earth=earth), optimise(odometry, closures, earth=spoiled)
    weights = weights_of_up(spoiled.up["beta"], result.trajectories["beta"].poses)
    assert (weights[wrong] < 0.1).all()
    assert (np.delete(weights, wrong) > 0.3).all()
    assert heights_off(result, truth) < 2 * heights_off(clean, truth) + 0.5


def test_without_it_nothing_changes(pair):
    _, odometry, closures = pair
    plain, same = optimise(odometry, closures), optimise(odometry, closures, earth=EarthMeasurements())
    for robot in odometry:
        np.testing.assert_array_equal(plain.trajectories[robot].poses, same.trajectories[robot].poses)
    assert not same.ground.earth


def test_streaming_approaches_the_batch_answer(pair):
    truth, odometry, closures = pair
    early = {robot: t.subset(np.arange(len(t) // 2)) for robot, t in odometry.items()}
    earth = earth_of(truth)
    known = {r: replace(up, index=up.index[up.index < len(early[r])], up_body=up.up_body[up.index < len(early[r])],
                        sigma_rad=up.sigma_rad[up.index < len(early[r])]) for r, up in earth.up.items()}  # fmt: skip
    stream = StreamingBackEnd(early, earth=EarthMeasurements(known))
    stream.extend(odometry, earth)
    stream.add(closures)
    batch = optimise(odometry, closures, earth=earth)
    for robot in odometry:
        apart = stream.poses(robot)[:, 2, 3] - batch.trajectories[robot].positions[:, 2]
        assert np.abs(apart).max() < 0.1 * heights_off(optimise(odometry, closures), truth) + 0.1


def test_two_stages_keep_frames_upright(pair):
    truth, odometry, closures = pair
    result = optimise(odometry, closures, PoseGraphSettings(optimiser="two-stage"), earth=earth_of(truth))
    plain = optimise(odometry, closures, PoseGraphSettings(optimiser="two-stage"))
    tilts = [np.degrees(np.arccos(min(1.0, r.T_world_odom["beta"][2, 2]))) for r in (plain, result)]
    assert tilts[1] < 0.3 < tilts[0]


def test_one_robot_with_positions_places_all(pair):
    truth, odometry, closures = pair
    T_enu_world = se3.from_yaw(2.0, np.array([1000.0, -500.0, 120.0]))
    earth = EarthMeasurements(earth_of(truth).up, {"beta": fixes_of(truth["beta"], T_enu_world=T_enu_world)})
    result = optimise(odometry, closures, earth=earth)
    assert result.ground.placed == ("alpha", "beta")
    for robot, most_m in (("beta", 2.0), ("alpha", 30.0)):  # alpha drifts away from where they met
        off = np.linalg.norm(result.trajectories[robot].positions - (T_enu_world @ truth[robot])[:, :3, 3], axis=1)
        assert np.median(off) < most_m
    plain = optimise(odometry, closures, earth=earth_of(truth))
    spread = [np.ptp(r.trajectories["beta"].positions[:, :2], axis=0) for r in (plain, result)]
    assert not np.allclose(*spread, atol=10)  # the world did turn


def test_reflected_fixes_are_outvoted(pair):
    truth, odometry, closures = pair
    fixes = fixes_of(truth["alpha"])
    wrong = np.array([4, 11, 20])
    position = fixes.position_enu.copy()
    position[wrong] += [40.0, -30.0, 20.0]
    spoiled = replace(fixes, position_enu=position)
    result = optimise(odometry, closures, earth=EarthMeasurements({}, {"alpha": spoiled}))
    weights = weights_of_fixes(spoiled, result.trajectories["alpha"].poses)
    assert (weights[wrong] < 0.05).all()
    off = np.linalg.norm(result.trajectories["alpha"].positions - truth["alpha"][:, :3, 3], axis=1)
    assert np.median(off) < 1.5


def test_robots_that_never_meet_share_the_earth(pair):
    truth, odometry, _ = pair
    earth = EarthMeasurements(earth_of(truth).up, {robot: fixes_of(poses) for robot, poses in truth.items()})
    result = optimise(odometry, [], earth=earth)
    assert result.components == (("alpha", "beta"),)
    for robot, poses in truth.items():
        assert np.median(np.linalg.norm(result.trajectories[robot].positions - poses[:, :3, 3], axis=1)) < 1.5


@pytest.mark.parametrize(("rows", "words"), [(2, "do not place"), (4, "heading")])
def test_fixes_that_tell_too_little_leave_the_frame(pair, rows, words):
    truth, odometry, closures = pair
    fixes = fixes_of(truth["alpha"], sigma_m=20.0).after(30 - rows)
    result = optimise(odometry, closures, earth=EarthMeasurements({}, {"alpha": fixes}))
    assert result.ground.placed == ()
    assert any(words in sentence for sentence in result.diagnosis)
    np.testing.assert_allclose(result.trajectories["alpha"].poses[0], np.eye(4), atol=1e-6)


def test_the_graph_file_tells_each_direction_and_its_fate(pair, tmp_path):
    truth, odometry, closures = pair
    earth = EarthMeasurements(earth_of(truth).up, {"beta": fixes_of(truth["beta"])})
    write_g2o(optimise(odometry, closures, earth=earth), tmp_path / "graph.g2o")
    lines = (tmp_path / "graph.g2o").read_text().splitlines()
    up, fixes = ([line for line in lines if line.startswith(tag)] for tag in ("# UP ", "# GNSS "))
    assert len(up) == 1 + sum(map(len, earth.up.values()))
    assert len(fixes) == 25
    assert fixes[0].startswith("# GNSS 300 ")  # beta's first vertex
    assert all(": used, weight 0." in line or ": used, weight 1." in line or ": outvoted" in line for line in up[1:])


def test_only_what_is_new_is_added():
    known = Ground(EarthMeasurements({"a": up_of(true_poses(50))}))
    more = replace(known, earth=EarthMeasurements({"a": up_of(true_poses(80)), "b": up_of(true_poses(20))}))
    new = more.since(known).earth.up
    assert new["a"].index.tolist() == [50, 55, 60, 65, 70, 75]
    assert len(new["b"]) == 4
