"""Measurements as arrays: whoever received, whatever axes, wherever the antenna sits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.types import AoaPath, FloatArray, Heading, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

SETTINGS = AlignmentSettings()
STAMPS = np.arange(30) * 1_000_000_000


def links_of(trajectories: dict[str, Trajectory], wireless: WirelessLog) -> Links:
    return TeamLinks.of(trajectories, wireless, GatheringLimits.of(AlignmentSettings())).by_pair["a", "b"]


def robots(seed: int) -> tuple[dict[str, FloatArray], dict[str, FloatArray], dict[str, Trajectory]]:
    """World poses, `T_world_odom`, and odometry of two tilting robots in odometry frames that are level."""
    rng = np.random.default_rng(seed)
    world, T_world_odom, odometry = {}, {}, {}
    for name in ("a", "b"):
        steps = np.concatenate([rng.normal(0, [0.05, 0.05, 0.2], (30, 3)), rng.normal(0, [1, 1, 0.1], (30, 3))], axis=1)
        T = se3.from_yaw(rng.uniform(-3, 3), rng.uniform(-20, 20, 3))
        world[name] = np.array([T := T @ se3.exp(step) for step in steps])
        T_world_odom[name] = se3.from_yaw(rng.uniform(-3, 3), rng.uniform(-20, 20, 3))
        odometry[name] = Trajectory(name, STAMPS, se3.inverse(T_world_odom[name]) @ world[name])
    return world, T_world_odom, odometry


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.sampled_from(["body", "odometry", "world"]), st.booleans())
def test_perfect_measurements_are_predicted_exactly(seed: int, frame: str, a_receives: bool) -> None:
    world, T_world_odom, odometry = robots(seed)
    rng = np.random.default_rng(seed + 1)
    receiver, transmitter = ("a", "b") if a_receives else ("b", "a")
    arm_r, arm_t = rng.normal(0, 0.5, (2, 3))
    i, j = rng.integers(0, 30, 2)
    v_world = world[transmitter][j] @ [*arm_t, 1] - world[receiver][i] @ [*arm_r, 1]
    R_world_axes = {
        "body": world[receiver][i, :3, :3],
        "odometry": T_world_odom[receiver][:3, :3],
        "world": np.eye(3),
    }[frame]
    v = R_world_axes.T @ v_world[:3]
    path = AoaPath(float(np.arctan2(v[1], v[0])), 0.1, 1.0, float(np.arctan2(v[2], np.hypot(v[0], v[1]))))
    measurement = WirelessMeasurement(
        int(STAMPS[i]), receiver, transmitter, float(np.linalg.norm(v)), 0.1, (path,), frame, int(STAMPS[j]),
        tuple(arm_r), tuple(arm_t),
    )  # fmt: skip
    headings = tuple(
        Heading(int(STAMPS[k]), n, float(se3.yaw(odometry[n].poses[k]) + se3.yaw(T_world_odom[n])), 0.01)
        for n in ("a", "b")
        for k in range(30)
    )
    links = links_of(odometry, WirelessLog((measurement,), headings))
    X = se3.between(T_world_odom["a"], T_world_odom["b"])
    v_odom = se3.transform(X, links.antenna_b) - links.antenna_a
    if not a_receives:
        v_odom = se3.transform(se3.inverse(X), links.antenna_a) - links.antenna_b
    assert links.range_m[0] == pytest.approx(np.linalg.norm(v_odom))
    np.testing.assert_allclose(links.direction[0, 0], v_odom[0] / np.linalg.norm(v_odom), atol=1e-9)
    assert np.angle(np.exp(1j * (links.yaw[0] - se3.yaw(X)))) == pytest.approx(0, abs=1e-9)
    keyframe_a = odometry["a"].poses[links.index_a]
    np.testing.assert_allclose(se3.transform(keyframe_a, links.antenna_keyframe_a), links.antenna_a, atol=1e-9)
    receiver_index = links.index_a if a_receives else links.index_b
    R_odom_keyframe = odometry[receiver].poses[receiver_index, :3, :3]
    np.testing.assert_allclose(R_odom_keyframe @ links.R_keyframe_axes, links.R_odom_axes, atol=1e-9)


def heard(stamp_s: float, **changes: object) -> WirelessMeasurement:
    plain = WirelessMeasurement(round(stamp_s * 1e9), "a", "b", 5.0, 0.5, (AoaPath(0.1, 0.2),))
    return dataclasses.replace(plain, **changes)


def test_measurements_outside_the_time_are_left_out_and_counted() -> None:
    _, _, odometry = robots(0)
    log = WirelessLog((heard(-100), heard(3), heard(29.1), heard(29.5)))
    links = links_of(odometry, log)
    assert links.measurement.tolist() == [1, 2]
    assert links.left_out == ("2 of 4 measurements lie outside the trajectories' time",)


def test_bearings_in_world_axes_need_the_receivers_heading() -> None:
    _, _, odometry = robots(0)
    log = WirelessLog((heard(3, aoa_frame="world"), heard(4)))
    links = links_of(odometry, log)
    assert links.has_bearing.tolist() == [False, True]
    assert links.has_range.all()
    assert "1 bearings in world axes" in links.left_out[0]


def test_other_robots_measurements_are_not_looked_at() -> None:
    _, _, odometry = robots(0)
    log = WirelessLog((heard(1, transmitter="c"), heard(2), heard(3, receiver="b", transmitter="a")))
    links = links_of(odometry, log)
    assert links.measurement.tolist() == [1, 2]
    assert links.a_receives.tolist() == [True, False]


def test_only_the_strongest_of_hundreds_of_paths_are_looked_at() -> None:
    _, _, odometry = robots(0)
    many = tuple(AoaPath(0.01 * k, 0.1, weight=float(k)) for k in range(300))
    links = links_of(odometry, WirelessLog((heard(1, paths=many), heard(2))))
    assert links.path[0].tolist() == list(range(299, 299 - SETTINGS.radio.max_paths, -1))
    np.testing.assert_allclose(links.weight.sum(axis=1), 1)


def test_no_measurement_is_no_link() -> None:
    _, _, odometry = robots(0)
    assert len(links_of(odometry, WirelessLog())) == 0


def test_headings_are_averaged_without_getting_surer() -> None:
    _, T_world_odom, odometry = robots(4)
    rng = np.random.default_rng(0)
    yaw = {n: se3.yaw(odometry[n].poses) + se3.yaw(T_world_odom[n]) for n in ("a", "b")}
    headings = tuple(
        Heading(int(STAMPS[k]), n, float(yaw[n][k] + rng.normal(0, 0.05)), 0.05) for n in ("a", "b") for k in range(30)
    )
    links = links_of(odometry, WirelessLog((heard(15),), headings))
    true = se3.yaw(se3.between(T_world_odom["a"], T_world_odom["b"]))
    assert abs(np.angle(np.exp(1j * (links.yaw[0] - true)))) < 0.08
    assert links.yaw_sigma[0] == pytest.approx(0.05 * np.sqrt(2))
    far = links_of(odometry, WirelessLog((heard(15),), headings[:3]))
    assert np.isnan(far.yaw[0])


def test_a_team_is_gathered_once_for_each_two_robots() -> None:
    _, _, odometry = robots(0)
    team = odometry | {"c": Trajectory("c", STAMPS, odometry["a"].poses)}
    log = WirelessLog((heard(1), heard(2, receiver="c", transmitter="b"), heard(3, receiver="zeta")))
    links = TeamLinks.of(team, log, GatheringLimits.of(SETTINGS)).by_pair
    assert list(links) == [("a", "b"), ("b", "c")]
    assert [between.measurement.tolist() for between in links.values()] == [[0], [1]]
    assert [links[pair].heard for pair in (("a", "b"), ("a", "c"), ("b", "c"))] == [True, False, True]
    assert links["b", "c"].a_receives.tolist() == [False]


def test_measurements_that_cannot_be_used_were_heard_all_the_same() -> None:
    _, _, odometry = robots(0)
    links = links_of(odometry, WirelessLog((heard(-100),)))
    assert links.heard
    assert len(links) == 0


def test_compasses_are_left_aside_where_asked() -> None:
    _, _, odometry = robots(0)
    headings = tuple(Heading(int(STAMPS[k]), name, 0.3, 0.05) for name in ("a", "b") for k in range(30))
    log = WirelessLog((heard(3),), headings)
    for heading, known in (("auto", True), ("heading", True), ("one-way", False)):
        limits = GatheringLimits.of(AlignmentSettings(heading=heading))
        assert np.isfinite(TeamLinks.of(odometry, log, limits).by_pair["a", "b"].yaw[0]) == known


def test_links_tell_where_each_robot_was() -> None:
    _, _, odometry = robots(0)
    links = links_of(odometry, WirelessLog((heard(3), heard(7))))
    for robot, index, antenna in (("a", links.index_a, links.antenna_a), ("b", links.index_b, links.antenna_b)):
        np.testing.assert_array_equal(links.at(robot)[0], index)
        np.testing.assert_array_equal(links.at(robot)[1], antenna)
        np.testing.assert_allclose(antenna, odometry[robot].positions[[3, 7]], atol=1e-9)
