from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.pipeline.config import load_config
from wiclosure.types import (
    AoaPath,
    FloatArray,
    FrameAlignment,
    Heading,
    IntArray,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.alignment.radio_check import RadioConsistencyCheck
from wiclosure.wiclosure_filter.config import AlignmentSettings, FilterSettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks

PAPER = load_config("paper").filter
SIGMA_RAD, SIGMA_M = np.radians(10.0), 0.3
CLOSE = np.diag(np.square([0.01, 0.01, 0.01, 0.1, 0.1, 0.1]))
KEYFRAMES = 100


def winding(start: tuple[float, float], heading: float, turn: float) -> FloatArray:
    yaw = heading + turn * np.sin(np.arange(KEYFRAMES) / 12.0)
    steps = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(KEYFRAMES)], axis=1)
    return se3.from_yaw(yaw, np.cumsum(steps, axis=0) + np.array([*start, 0.0]))


def team(drift: DriftModel | None = None) -> dict[str, Trajectory]:
    stamps_ns = np.arange(KEYFRAMES, dtype=np.int64) * 10**9
    drift = drift or DriftModel()
    return {
        "alpha": Trajectory("alpha", stamps_ns, winding((0.0, 0.0), 0.2, 1.2), drift),
        "beta": Trajectory("beta", stamps_ns, winding((60.0, 20.0), 2.8, 1.4), drift),
    }


def heard(truth: dict[str, Trajectory], count: int, rng: np.random.Generator) -> WirelessLog:
    """Ranges, and bearings with two false paths each; every fourth profile lacks the direct path."""
    measurements = []
    for number, k in enumerate(np.linspace(5, KEYFRAMES - 5, count).astype(int)):
        seen = se3.between(truth["alpha"].poses[k], truth["beta"].poses[k])[:3, 3]
        azimuths = rng.uniform(-np.pi, np.pi, 3)
        if number % 4 < 3:
            azimuths[0] = np.arctan2(seen[1], seen[0]) + rng.normal(0, SIGMA_RAD)
        paths = tuple(AoaPath(float(azimuth), float(SIGMA_RAD), 1 / 3) for azimuth in azimuths)
        range_m = float(np.linalg.norm(seen) + rng.normal(0, SIGMA_M))
        measurements.append(WirelessMeasurement(int(k) * 10**9, "alpha", "beta", range_m, SIGMA_M, paths))
    return WirelessLog(tuple(measurements))


def odometry_of(truth: dict[str, Trajectory]) -> dict[str, Trajectory]:
    return {robot: t.moved(se3.inverse(t.poses[0])) for robot, t in truth.items()}


def check_of(
    odometry: dict[str, Trajectory], log: WirelessLog, settings: AlignmentSettings | None = None
) -> tuple[RadioConsistencyCheck | None, FrameAlignment]:
    settings = settings or AlignmentSettings()
    links = TeamLinks.of(odometry, log, GatheringLimits.of(settings)).by_pair["alpha", "beta"]
    alignment = align(links, odometry, settings)
    return RadioConsistencyCheck.of(alignment, links, odometry, settings, max_odds=100.0), alignment


def closures(truth: dict[str, Trajectory], shift_m: tuple[float, float]) -> tuple[FloatArray, FloatArray, IntArray]:
    """Measured poses of keyframes of beta in those of alpha, were beta's path moved in the world."""
    index = np.arange(0, KEYFRAMES, 7)
    moved = truth["beta"].poses[index].copy()
    moved[:, :2, 3] += shift_m
    return se3.between(truth["alpha"].poses[index], moved), np.tile(CLOSE, (len(index), 1, 1)), index


@pytest.mark.parametrize("count", [4, 6, 30])
@pytest.mark.parametrize("seed", range(4))
def test_the_radio_objects_to_look_alike_places_and_not_to_the_true_one(count: int, seed: int) -> None:
    """Also with a handful of measurements, which often leave more than one alignment to choose from."""
    truth = team()
    check, _ = check_of(odometry_of(truth), heard(truth, count, np.random.default_rng(seed)))
    assert check is not None
    T, covariance, index = closures(truth, (0.0, 0.0))
    assert check.objections(T, covariance, index, index) == ("",) * len(index)
    for shift_m in ((12.0, 0.0), (0.0, -12.0), (-9.0, 9.0)):
        T, covariance, index = closures(truth, shift_m)
        objections = check.objections(T, covariance, index, index)
        assert sum(bool(objection) for objection in objections) >= 0.75 * len(index)
        assert all("contradicts the radio" in objection for objection in objections if objection)


def test_odds_are_those_of_the_likeliest_alignment() -> None:
    """Against itself they are even, and the closures' own covariance lets them err."""
    truth = team()
    check, alignment = check_of(odometry_of(truth), heard(truth, 20, np.random.default_rng(1)))
    assert check is not None
    assert alignment.best is not None
    odometry, index = odometry_of(truth), np.arange(0, KEYFRAMES, 9)
    T = se3.inverse(odometry["alpha"].poses[index]) @ alignment.best.T_a_b @ odometry["beta"].poses[index]
    exact = np.tile(1e-12 * np.eye(6), (len(index), 1, 1))
    assert check.log_odds(T, exact, index, index).max() < np.log(3.0)
    T, covariance, index = closures(truth, (3.0, 0.0))
    sharp, vague = (check.log_odds(T, scale * covariance, index, index) for scale in (1.0, 1e4))
    assert (vague < sharp).all()


def drifted(truth: Trajectory, factor: float, rng: np.random.Generator) -> Trajectory:
    """Odometry that errs as its drift model says, times a factor."""
    steps = se3.between(truth.poses[:-1], truth.poses[1:])
    metres, turn = np.linalg.norm(steps[:, :3, 3], axis=1), se3.rotation_angle(steps)
    sigma = np.empty((len(steps), 6))
    drift = truth.drift
    sigma[:, :3] = np.sqrt(drift.rotation_walk**2 * metres + drift.rotation_walk_turning**2 * turn)[:, None]
    sigma[:, 3:] = (drift.translation_walk * np.sqrt(metres))[:, None]
    poses = [np.eye(4)]
    for step in steps @ se3.exp(factor * sigma * rng.normal(size=sigma.shape)):
        poses.append(poses[-1] @ step)
    return Trajectory(truth.robot, truth.stamps_ns, np.array(poses), drift)


@pytest.mark.parametrize(
    ("count", "last_s", "across", "factor"),
    [(20, 33, False, 1.0), (60, 33, False, 2.0), (60, 100, True, 1.0), (200, 100, True, 1.0)],
)
def test_true_closures_stand_however_much_was_measured_before_the_odometry_drifted(
    count: int, last_s: int, across: bool, factor: float
) -> None:
    """Drift since the radio was used is one error of all measurements; scored for each, it would refuse the truth."""
    refused, found = [], []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        truth = {
            robot: Trajectory(robot, t.stamps_ns, se3.from_rotation_translation(t.poses[:, :3, :3], 5 * t.positions))
            for robot, t in team().items()
        }
        odometry = {robot: drifted(t, factor, rng) for robot, t in truth.items()}
        log = heard(truth, 3 * count if last_s < KEYFRAMES else count, rng)
        log = WirelessLog(tuple(m for m in log.measurements if m.stamp_ns < last_s * 10**9))
        check, _ = check_of(odometry, log)
        assert check is not None
        index_a = np.arange(67, KEYFRAMES, 3)
        index_b = index_a - 60 if across else index_a
        T_beta = truth["beta"].poses[index_b]
        covariance = np.tile(CLOSE, (len(index_a), 1, 1))
        noise = se3.exp(rng.normal(size=(len(index_a), 6)) * np.sqrt(np.diag(CLOSE)))
        for shift_m, told in ((0.0, refused), (60.0, found)):
            moved = T_beta.copy()
            moved[:, 0, 3] += shift_m
            T = se3.between(truth["alpha"].poses[index_a], moved) @ noise
            told += [bool(objection) for objection in check.objections(T, covariance, index_a, index_b)]
    assert np.mean(refused) <= (0.02 if factor == 1 else 0.1)
    assert np.mean(found) >= 0.9


@pytest.mark.parametrize("compasses", [False, True])
def test_an_inexact_closure_is_judged_by_what_it_allows(compasses: bool) -> None:
    """A point-to-point registration turned by 3 degrees, and compasses from before the odometry turned as much."""
    truth = team()
    log = heard(truth, 30, np.random.default_rng(5))
    if compasses:
        headings = tuple(
            Heading(k * 10**9, robot, float(se3.yaw(t.poses[k])), 0.03) for robot, t in truth.items() for k in (5, 10)
        )
        log = WirelessLog(log.measurements, headings)
    check, _ = check_of(odometry_of(truth), log)
    assert check is not None
    T, _, index = closures(truth, (0.0, 0.0))
    T = T @ se3.from_yaw(0.05, np.zeros(3))
    honest = np.tile(np.diag(np.repeat([0.05**2, 0.3**2], 3)), (len(T), 1, 1))
    assert check.objections(T, honest, index, index) == ("",) * len(T)
    # As DiSCo-SLAM states it, one variance for metres and radians, which must not excuse a wrong place.
    wrong, _, _ = closures(truth, (12.0, 0.0))
    assert all(check.objections(wrong, np.tile(np.eye(6), (len(T), 1, 1)), index, index))


def test_far_from_every_measurement_drift_leaves_nothing_to_object_to() -> None:
    """Measurements are all made at the start, and the odometry drifts metres until the closure."""
    truth = team(DriftModel(translation_walk=1.0, rotation_walk=0.05))
    log = heard(truth, 60, np.random.default_rng(0))
    early = WirelessLog(tuple(m for m in log.measurements if m.stamp_ns < 20 * 10**9))
    check, _ = check_of(odometry_of(truth), early)
    assert check is not None
    T, covariance, index = closures(truth, (5.0, 0.0))
    late = index > 80
    assert check.objections(T[late], covariance[late], index[late], index[late]) == ("",) * late.sum()


def test_tilted_frames_and_robots_that_were_not_aligned_have_no_check() -> None:
    truth = team()
    log = heard(truth, 8, np.random.default_rng(0))
    assert check_of(odometry_of(truth), log, AlignmentSettings(gravity_aligned=False))[0] is None
    assert check_of(odometry_of(truth), WirelessLog())[0] is None


def test_the_filter_brings_them_along_unless_told_otherwise() -> None:
    """Where it cannot predict: a prediction has all links of all robots behind it, and registration asks it already."""
    truth = team()
    odometry, log = odometry_of(truth), heard(truth, 4, np.random.default_rng(5))
    found = WiClosureFilter().candidates(odometry, log)
    assert found.alignments[0].ambiguous
    assert set(found.checks) == {("alpha", "beta")}
    certain = WiClosureFilter().candidates(odometry, heard(truth, 30, np.random.default_rng(1)))
    assert not certain.alignments[0].ambiguous
    assert not certain.checks
    assert not WiClosureFilter(FilterSettings(closure_odds=None)).candidates(odometry, log).checks
    assert not WiClosureFilter(PAPER).candidates(odometry, log).checks
    assert not WiClosureFilter().candidates(odometry, WirelessLog()).checks
