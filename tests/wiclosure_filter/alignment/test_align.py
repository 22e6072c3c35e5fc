"""Frame alignment: exact on perfect input, right under multipath, and honest where the radio cannot tell."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import (
    AlignmentHypothesis,
    AoaPath,
    FloatArray,
    FrameAlignment,
    Heading,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks

SETTINGS = AlignmentSettings()
KINDS = ["heading", "reciprocal", "one-way", "range-only"]


def align_robots(
    robot_a: str,
    robot_b: str,
    trajectories: dict[str, Trajectory],
    wireless: WirelessLog,
    settings: AlignmentSettings = SETTINGS,
) -> FrameAlignment:
    team = {robot: trajectories[robot] for robot in (robot_a, robot_b)}
    links = TeamLinks.of(team, wireless, GatheringLimits.of(settings))
    return align(links.by_pair[robot_a, robot_b], team, settings)


@dataclass(frozen=True, eq=False)
class Scene:
    trajectories: dict[str, Trajectory]
    wireless: WirelessLog
    T_a_b: FloatArray
    direct: dict[int, int]  # which path of each measurement is the direct one; -1 where none is

    def align(self, settings: AlignmentSettings = SETTINGS) -> FrameAlignment:
        return align_robots("a", "b", self.trajectories, self.wireless, settings)

    def error_m(self, found: FrameAlignment | AlignmentHypothesis) -> float:
        best = found.best if isinstance(found, FrameAlignment) else found
        assert best is not None
        b = self.trajectories["b"].positions
        return float(np.linalg.norm(se3.transform(best.T_a_b, b) - se3.transform(self.T_a_b, b), axis=1).mean())


def wander(rng: np.random.Generator, count: int, step_m: float = 1.0) -> FloatArray:
    """Level world poses of a robot that turns left and right inside some 30 m."""
    yaw = rng.uniform(-3, 3) + np.cumsum(rng.normal(0, 0.35, count))
    steps = step_m * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(count)])
    return se3.from_yaw(yaw, np.cumsum(steps, axis=0) + rng.uniform(-8, 8, 3) * [1, 1, 0])


def make_scene(
    kind: str = "one-way",
    *,
    seed: int = 0,
    heard: int = 12,
    false_paths: int = 4,
    noise: float = 1.0,
    absent: float = 0.0,
    gross: float = 0.0,
    world: dict[str, FloatArray] | None = None,
    frames: dict[str, FloatArray] | None = None,
    elevated: bool = False,
) -> Scene:
    """Two robots that hear each other `heard` times; noise 1 is 10 degrees and 0.3 m."""
    rng = np.random.default_rng(seed)
    world = world or {name: wander(rng, 60) for name in ("a", "b")}
    count = len(world["a"])
    stamps = np.arange(count) * 1_000_000_000
    drawn = {n: se3.from_yaw(rng.uniform(-3, 3), rng.uniform(-40, 40, 3) * [1, 1, 0]) for n in world}
    T_world_odom = frames or drawn
    measurements: list[WirelessMeasurement] = []
    direct: dict[int, int] = {}
    for k in np.linspace(0, count - 1, heard).astype(int):
        for receiver, transmitter in [("a", "b"), ("b", "a")] if kind == "reciprocal" else [("a", "b")]:
            v = se3.between(world[receiver][k], world[transmitter][k])[:3, 3]
            distance = float(np.linalg.norm(v) + noise * rng.normal(0, 0.3))
            distance = float(rng.uniform(0, 60)) if rng.random() < gross else max(distance, 0.0)
            azimuths = rng.uniform(-np.pi, np.pi, false_paths + 1)
            column = int(rng.integers(false_paths + 1)) if rng.random() >= absent else -1
            if column >= 0:
                azimuths[column] = np.arctan2(v[1], v[0]) + noise * rng.normal(0, np.radians(10))
            elevations = [None] * (false_paths + 1)
            if elevated:
                elevations = rng.uniform(-1, 1, false_paths + 1).tolist()
                true = np.arctan2(v[2], np.hypot(v[0], v[1])) + noise * rng.normal(0, np.radians(10))
                elevations[column] = float(np.clip(true, -1.57, 1.57)) if column >= 0 else elevations[column]
            paths = tuple(
                AoaPath(float(z), np.radians(10), elevation=up) for z, up in zip(azimuths, elevations, strict=True)
            )
            paths = () if kind == "range-only" else paths
            direct[len(measurements)] = column
            measurements.append(WirelessMeasurement(int(stamps[k]), receiver, transmitter, distance, 0.3, paths))
    headings = tuple(
        Heading(int(stamps[k]), n, float(se3.yaw(world[n][k]) + noise * rng.normal(0, 0.05)), 0.05)
        for n in world
        for k in range(0, count, 2)
        if kind == "heading"
    )
    trajectories = {n: Trajectory(n, stamps, se3.inverse(T_world_odom[n]) @ world[n]) for n in world}
    T_a_b = se3.between(T_world_odom["a"], T_world_odom["b"])
    return Scene(trajectories, WirelessLog(tuple(measurements), headings), T_a_b, direct)


# ---------------------------------------------------------------------------------------------------------- exactness
@settings(deadline=None, max_examples=12)
@given(st.sampled_from(KINDS), st.integers(0, 10**6))
def test_perfect_measurements_give_the_exact_frame(kind: str, seed: int) -> None:
    scene = make_scene(kind, seed=seed, noise=0.0, false_paths=0)
    certain = AlignmentSettings.model_validate({"drift_inflation": 1e-3, "radio": {"range_bias_m": 0.0}})
    found = scene.align(certain)
    assert found.heading_knowledge == kind
    assert scene.error_m(found) < 1e-3


@settings(deadline=None, max_examples=6)
@given(st.sampled_from(KINDS[:3]), st.integers(0, 10**6))
def test_the_odometry_frames_do_not_matter(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    moved = {n: se3.from_yaw(rng.uniform(-3, 3), rng.uniform(-500, 500, 3)) for n in ("a", "b")}
    still = {n: np.eye(4) for n in ("a", "b")}
    scenes = [make_scene(kind, seed=seed, frames=frames) for frames in (still, moved)]
    here, there = (scene.align() for scene in scenes)
    assert here.best is not None
    assert there.best is not None
    expected = se3.inverse(moved["a"]) @ here.best.T_a_b @ moved["b"]
    b = scenes[1].trajectories["b"].positions
    np.testing.assert_allclose(se3.transform(there.best.T_a_b, b), se3.transform(expected, b), atol=0.02)
    assert here.ambiguous == there.ambiguous


def test_equal_input_gives_equal_output() -> None:
    first, second = (make_scene(seed=5).align() for _ in range(2))
    assert first.best is not None
    assert second.best is not None
    assert np.array_equal(first.best.T_a_b, second.best.T_a_b)
    assert first.best.paths_kept == second.best.paths_kept


# ------------------------------------------------------------------------------------------------------------ multipath
@pytest.mark.parametrize("kind", KINDS[:3])
def test_direct_paths_are_told_from_false_ones(kind: str) -> None:
    found = certain = wrong = right = 0
    for seed in range(10):
        scene = make_scene(kind, seed=seed, absent=0.3, gross=0.1)
        result = scene.align()
        good = scene.error_m(result) < 4
        found += good
        certain += not result.ambiguous
        wrong += not result.ambiguous and not good
        assert result.best is not None
        right += sum(scene.direct[m] == path >= 0 for m, path in result.best.paths_kept)
    direct = sum(path >= 0 for seed in range(10) for path in make_scene(kind, seed=seed, absent=0.3).direct.values())
    assert found >= 9
    assert certain >= 8
    assert wrong == 0
    assert right > 0.6 * direct


@pytest.mark.parametrize("kind", KINDS[:2])
def test_pairwise_consistency_finds_the_frame_where_headings_are_known(kind: str) -> None:
    pcm = AlignmentSettings(multipath="pcm")
    scenes = [make_scene(kind, seed=seed) for seed in range(5)]
    assert sum(scene.error_m(scene.align(pcm)) < 4 for scene in scenes) >= 4
    result = scenes[0].align(pcm)
    assert result.best is not None
    rows = [m for m, _ in result.best.paths_kept]
    assert len(rows) == len(set(rows)) > 2  # at most one path a measurement


def test_pairwise_consistency_without_headings_says_what_to_do() -> None:
    result = make_scene("one-way").align(AlignmentSettings(multipath="pcm"))
    assert result.ambiguous
    assert result.best is None
    assert "consensus" in result.reason


@pytest.mark.parametrize("kind", KINDS)
def test_the_covariance_tells_the_error(kind: str) -> None:
    nees = []
    for seed in range(10):
        scene = make_scene(kind, seed=100 + seed, heard=20)
        result = scene.align()
        if not result.ambiguous:
            assert result.best is not None
            assert result.covariance is not None
            xi = se3.log(se3.inverse(result.best.T_a_b) @ scene.T_a_b)[[2, 3, 4]]
            nees.append(xi @ np.linalg.solve(result.covariance[np.ix_([2, 3, 4], [2, 3, 4])], xi))
    assert len(nees) > 7
    assert 0.03 * 3 < np.mean(nees) < 2 * 3  # rather too careful than too sure: no drift, no systematic errors here


# ---------------------------------------------------------------------------------------------------------------- drift
def drifted(world: FloatArray, rng: np.random.Generator, drift: DriftModel) -> FloatArray:
    """Odometry with errors as the drift model has them."""
    steps = se3.between(world[:-1], world[1:])
    length = np.linalg.norm(steps[:, :3, 3], axis=1)
    xi = np.zeros((len(steps), 6))
    xi[:, 2] = rng.normal(0, drift.rotation_walk * np.sqrt(length))
    xi[:, 3:5] = rng.normal(0, 1, (len(steps), 2)) * (drift.translation_walk * np.sqrt(length))[:, None]
    poses = [world[0]]
    for step in steps @ se3.exp(xi):
        poses.append(poses[-1] @ step)
    return np.array(poses)


def test_paths_are_told_apart_over_a_kilometre_of_drift() -> None:
    """No rigid transform explains these measurements; the direct paths are found all the same."""
    model = DriftModel(translation_walk=0.1, rotation_walk=0.015, translation_bias=0.0, rotation_bias=0.0)
    kept = false = direct = certain = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        world = {n: wander(rng, 250, step_m=4.0) for n in ("a", "b")}
        scene = make_scene("one-way", seed=seed, world=world, heard=100, absent=0.15, noise=0.5)
        trajectories = {
            n: Trajectory(n, t.stamps_ns, drifted(t.poses, rng, model), model) for n, t in scene.trajectories.items()
        }
        result = align_robots("a", "b", trajectories, scene.wireless, SETTINGS)
        assert result.best is not None
        assert result.fit is not None
        rows = dict(result.best.paths_kept)
        if not result.ambiguous:  # as it is drawn
            bearings, ranges = result.fit.agreeing_bearings.sum(), result.fit.agreeing_ranges.sum()
            assert result.reason == f"{bearings} bearings and {ranges} ranges of 100 measurements agree"
            assert sum(path >= 0 for path in rows.values()) == bearings
            certain += 1
        kept += sum(rows.get(m, -1) == path for m, path in scene.direct.items() if path >= 0)
        false += sum(rows.get(m, -1) not in {-1, path} for m, path in scene.direct.items())
        direct += sum(path >= 0 for path in scene.direct.values())
    assert certain > 0
    assert kept > 0.75 * direct
    assert false < 0.2 * direct


def test_thousands_of_measurements_take_no_longer() -> None:
    scene = make_scene("reciprocal", heard=60, seed=1)
    many = tuple(
        dataclasses.replace(m, stamp_ns=m.stamp_ns + k * 1000) for m in scene.wireless.measurements for k in range(50)
    )
    result = align_robots("a", "b", scene.trajectories, WirelessLog(many), SETTINGS)
    assert result.heading_knowledge == "reciprocal"
    assert scene.error_m(result) < 2
    assert "of 6000 measurements" in result.reason


# ------------------------------------------------------------------------------------------------------ it cannot tell
def test_no_measurement_says_so() -> None:
    scene = make_scene()
    result = align_robots("a", "b", scene.trajectories, WirelessLog(), SETTINGS)
    assert result.ambiguous
    assert result.best is None
    assert "no measurement" in result.reason


def test_one_bearing_is_not_enough() -> None:
    result = make_scene("one-way", heard=1, false_paths=0).align()
    assert result.ambiguous
    assert result.reason


def test_robots_that_stand_still_do_not_know_their_heading() -> None:
    still = {n: np.tile(se3.from_yaw(0.3, np.array([x, 0.0, 0])), (60, 1, 1)) for n, x in (("a", 0.0), ("b", 9.0))}
    result = make_scene("one-way", world=still, heard=60).align()
    assert result.ambiguous


def test_ranges_alone_between_straight_lines_do_not_fix_the_frame() -> None:
    along = np.linspace(0, 40, 60)
    world = {
        "a": se3.from_yaw(np.zeros(60), np.column_stack([along, 0 * along, 0 * along])),
        "b": se3.from_yaw(
            np.full(60, 0.2), np.column_stack([along * np.cos(0.2), 10 + along * np.sin(0.2), 0 * along])
        ),
    }
    scene = make_scene("range-only", world=world, heard=40)
    result = scene.align()
    assert result.ambiguous
    assert result.reason


def test_a_mirror_behind_robots_that_hardly_move_is_not_believed() -> None:
    """All that comes through is one reflection, consistent over a hundred measurements."""
    rng = np.random.default_rng(1)
    near = {n: np.tile(se3.from_yaw(0.0, np.array([x, 0.0, 0])), (100, 1, 1)) for n, x in (("a", 0.0), ("b", 10.0))}
    for poses in near.values():
        poses[:, :2, 3] += rng.normal(0, 0.1, (100, 2))
    scene = make_scene("heading", world=near, heard=100, false_paths=0, absent=0.0)
    mirrored = tuple(
        WirelessMeasurement(m.stamp_ns, "a", "b", m.range_m, m.range_sigma_m, (AoaPath(1.2, np.radians(10)),))
        for m in scene.wireless.measurements
    )
    result = align_robots("a", "b", scene.trajectories, WirelessLog(mirrored, scene.wireless.headings), SETTINGS)
    assert result.ambiguous
    assert "too little" in result.reason


def test_contradictory_measurements_are_not_certain() -> None:
    rng = np.random.default_rng(2)
    scene = make_scene("one-way", heard=12, absent=1.0, false_paths=1)
    noise = tuple(
        WirelessMeasurement(m.stamp_ns, "a", "b", float(rng.uniform(0, 60)), 0.3, m.paths)
        for m in scene.wireless.measurements
    )
    assert align_robots("a", "b", scene.trajectories, WirelessLog(noise), SETTINGS).ambiguous


def test_trajectories_of_one_pose() -> None:
    scene = make_scene("heading")
    one = {n: t.subset(np.array([0])) for n, t in scene.trajectories.items()}
    result = align_robots("a", "b", one, scene.wireless, SETTINGS)
    assert result.ambiguous
    assert "outside" in result.reason


# ------------------------------------------------------------------------------------------------------- tilted frames
def tilted(rng: np.random.Generator, angle_rad: float) -> dict[str, FloatArray]:
    """Odometry frames that lean in any direction."""
    frames = {}
    for name in ("a", "b"):
        towards = rng.uniform(-np.pi, np.pi)
        lean = se3.exp(angle_rad * np.array([np.cos(towards), np.sin(towards), 0, 0, 0, 0]))
        frames[name] = se3.from_yaw(rng.uniform(-3, 3), rng.uniform(-40, 40, 3)) @ lean
    return frames


def flights(rng: np.random.Generator) -> dict[str, FloatArray]:
    """Robots that also go up and down."""
    world = {n: wander(rng, 60) for n in ("a", "b")}
    for poses in world.values():
        poses[:, 2, 3] = np.cumsum(rng.normal(0, 0.7, 60))
    return world


@settings(deadline=None, max_examples=5)
@given(st.integers(0, 10**6), st.sampled_from([0.1, 0.5, 1.0]))
def test_tilted_frames_are_found_exactly_from_perfect_measurements(seed: int, angle_rad: float) -> None:
    rng = np.random.default_rng(seed)
    scene = make_scene(
        seed=seed, world=flights(rng), frames=tilted(rng, angle_rad), elevated=True, noise=0.0, false_paths=0, heard=20
    )
    space = AlignmentSettings.model_validate(
        {"gravity_aligned": False, "drift_inflation": 1e-3, "radio": {"range_bias_m": 0.0}}
        | {"tilt_sigma_rad": 100.0, "height_sigma_m": 1e4}
    )
    found = scene.align(space)
    assert scene.error_m(found) < 0.01


def test_tilted_frames_under_multipath() -> None:
    space = AlignmentSettings(gravity_aligned=False)
    errors, certain, nees = [], 0, []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        frames = tilted(rng, 0.3)
        scene = make_scene(seed=seed, world=flights(rng), frames=frames, elevated=True, heard=20, absent=0.15)
        found = scene.align(space)
        errors.append(scene.error_m(found))
        certain += not found.ambiguous
        assert found.best is not None
        assert found.covariance is not None
        xi = se3.log(se3.inverse(found.best.T_a_b) @ scene.T_a_b)
        nees.append(xi @ np.linalg.solve(found.covariance, xi))
    assert max(errors) < 6  # at ranges of 10 to 60 m
    assert certain >= 7
    assert 0.15 * 6 < np.median(nees) < 2 * 6


# ------------------------------------------------------------------------------------------------- kinds of measurement
def test_bearings_and_ranges_in_separate_records() -> None:
    scene = make_scene("one-way", heard=20, seed=3)
    apart = []
    for m in scene.wireless.measurements:
        apart.append(WirelessMeasurement(m.stamp_ns, "a", "b", m.range_m, m.range_sigma_m))
        apart.append(WirelessMeasurement(m.stamp_ns + 1000, "a", "b", paths=m.paths))
    result = align_robots("a", "b", scene.trajectories, WirelessLog(tuple(apart)), SETTINGS)
    assert scene.error_m(result) < 3


def test_bearings_alone_of_robots_that_move() -> None:
    scene = make_scene("one-way", heard=30, seed=4, false_paths=1)
    alone = tuple(WirelessMeasurement(m.stamp_ns, "a", "b", paths=m.paths) for m in scene.wireless.measurements)
    result = align_robots("a", "b", scene.trajectories, WirelessLog(alone), SETTINGS)
    assert scene.error_m(result) < 4


def test_heading_can_be_overridden() -> None:
    scene = make_scene("heading", heard=20)
    result = scene.align(AlignmentSettings(heading="one-way"))
    assert result.heading_knowledge == "one-way"
    assert scene.error_m(result) < 4


# -------------------------------------------------------------------------------------------------------- strange input
angles = st.floats(-2 * np.pi, 2 * np.pi)
strange_paths = st.lists(
    st.builds(
        AoaPath,
        azimuth=angles,
        sigma=st.sampled_from([1e-6, 0.1, 3.0, 1e3]),
        weight=st.sampled_from([0.0, 1e-300, 1.0, 1e9]),
        elevation=st.none() | st.sampled_from([-np.pi / 2, 0.0, 0.3, np.pi / 2]),
    ),
    max_size=3,
)
strange_headings = st.builds(
    Heading, st.integers(0, 10**10), st.sampled_from(["a", "b"]), angles, st.sampled_from([1e-6, 0.1, 1e3])
)
arms = st.sampled_from([(0.0, 0.0, 0.0), (0.3, -0.2, 1.0)])


@st.composite
def strange_measurements(draw: st.DrawFn) -> WirelessMeasurement:
    paths = tuple(draw(strange_paths))
    ranged = draw(st.booleans()) or not paths
    receiver, transmitter = draw(st.sampled_from([("a", "b"), ("b", "a")]))
    return WirelessMeasurement(
        stamp_ns=draw(st.integers(-1, 11)) * 1_000_000_000,
        receiver=receiver,
        transmitter=transmitter,
        range_m=draw(st.sampled_from([0.0, 1e-12, 5.0, 1e4])) if ranged else None,
        range_sigma_m=draw(st.sampled_from([1e-6, 0.5, 1e6])) if ranged else None,
        paths=paths,
        aoa_frame=draw(st.sampled_from(["body", "odometry", "world"])),
        lever_arm_receiver=draw(arms),
    )


@settings(deadline=None, max_examples=60)
@given(
    st.lists(strange_measurements(), max_size=12),
    st.lists(
        st.builds(Heading, st.integers(0, 10**10), st.sampled_from(["a", "b"]), angles, st.just(1e-6)), max_size=4
    ),
    st.sampled_from(["still", "line", "wander", "one pose"]),
    st.sampled_from([{}, {"gravity_aligned": False}, {"multipath": "pcm"}, {"heading": "range-only"}]),
)
def test_strange_input_gives_an_answer_and_a_reason(
    measurements: list[WirelessMeasurement], headings: list[Heading], motion: str, changes: dict[str, object]
) -> None:
    rng = np.random.default_rng(0)
    world = {n: wander(rng, 11) for n in ("a", "b")}
    if motion != "wander":
        along = np.column_stack([np.arange(11.0) * (motion == "line"), np.zeros(11), np.zeros(11)])
        world = {n: se3.from_yaw(np.zeros(11), along) for n in ("a", "b")}
    count = 1 if motion == "one pose" else 11
    stamps = np.arange(count) * 1_000_000_000
    trajectories = {n: Trajectory(n, stamps, poses[:count]) for n, poses in world.items()}
    result = align_robots(
        "a", "b", trajectories, WirelessLog(tuple(measurements), tuple(headings)), AlignmentSettings(**changes)
    )
    assert result.reason
    assert "\n" not in result.reason
    if result.best is None:
        assert result.ambiguous
        return
    assert result.covariance is not None
    assert np.isfinite(result.best.T_a_b).all()
    assert np.isfinite(result.covariance).all()
    assert np.isfinite(result.best.log_likelihood)
    assert np.linalg.eigvalsh(result.covariance).min() > -1e-6 * np.linalg.eigvalsh(result.covariance).max()
    rows = [m for m, _ in result.best.paths_kept]
    assert len(rows) == len(set(rows))
    assert all(-1 <= k < len(measurements[m].paths) for m, k in result.best.paths_kept)
