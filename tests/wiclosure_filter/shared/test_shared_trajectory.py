"""The shared trajectory: exact on perfect input, calibrated on noisy input, honest about what it does not know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import (
    AlignmentHypothesis,
    AoaPath,
    FrameAlignment,
    Heading,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.config import AlignmentSettings, FilterSettings, SharedTrajectorySettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedTrajectory

from ..one_road import winding_road  # noqa: TID252  -- test folders are no packages

TRUE_FRAMES = {
    "alpha": se3.from_yaw(0.0, np.zeros(3)),
    "beta": se3.from_yaw(1.1, np.array([40.0, -20.0, 2.0])),
    "gamma": se3.from_yaw(-2.0, np.array([-30.0, 50.0, -1.0])),
}
DRIFT = DriftModel(translation_walk=0.05, rotation_walk=0.001, rotation_walk_turning=0.003)


def team(seed: int, robots: list[str]) -> tuple[dict[str, Trajectory], dict[str, Trajectory]]:
    """True trajectories in the frame of alpha, and perfect odometry."""
    odometry = {
        r: Trajectory(r, np.arange(150, dtype=np.int64) * 10**9, winding_road(seed * 7 + i), DRIFT)
        for i, r in enumerate(robots)
    }
    return {r: odometry[r].moved(TRUE_FRAMES[r]) for r in robots}, odometry


def drifted(perfect: Trajectory, rng: np.random.Generator, drift: DriftModel) -> Trajectory:
    """Odometry whose steps err as the drift model says."""
    steps = se3.between(perfect.poses[:-1], perfect.poses[1:])
    poses = [perfect.poses[0]]
    length, turn = np.linalg.norm(steps[:, :3, 3], axis=1), se3.rotation_angle(steps)
    sigma = np.empty((len(steps), 6))
    sigma[:, :3] = np.sqrt(drift.rotation_walk**2 * length + drift.rotation_walk_turning**2 * turn)[:, None]
    sigma[:, 3:] = (drift.translation_walk * np.sqrt(length))[:, None]
    for step, error in zip(steps, se3.exp(rng.normal(size=sigma.shape) * sigma), strict=True):
        poses.append(poses[-1] @ step @ error)
    return Trajectory(perfect.robot, perfect.stamps_ns, np.array(poses), drift)


def listen(
    truth: dict[str, Trajectory],
    receiver: str,
    transmitter: str,
    rng: np.random.Generator | None = None,
    every: int = 10,
    arms: tuple[tuple[float, float, float], tuple[float, float, float]] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    elevation: bool = True,
) -> WirelessLog:
    """Range and bearing of the direct path; exact without a generator."""
    heard = []
    for index in range(0, len(truth[receiver]), every):
        T_r, T_t = truth[receiver].poses[index], truth[transmitter].poses[index]
        antenna = se3.transform(T_t, np.array([arms[1]]))
        seen = (antenna - se3.transform(T_r, np.array([arms[0]])))[0] @ T_r[:3, :3]
        noise = np.zeros(3) if rng is None else rng.normal(0, [0.5, 0.1, 0.1])
        heard.append(
            WirelessMeasurement(
                int(truth[receiver].stamps_ns[index]),
                receiver,
                transmitter,
                range_m=abs(float(np.linalg.norm(seen) + noise[0])),
                range_sigma_m=0.5,
                paths=(
                    AoaPath(
                        float(np.arctan2(seen[1], seen[0]) + noise[1]),
                        0.1,
                        elevation=float(np.arcsin(seen[2] / np.linalg.norm(seen)) + noise[2]) if elevation else None,
                    ),
                ),
                lever_arm_receiver=arms[0],
                lever_arm_transmitter=arms[1],
            )
        )
    return WirelessLog(tuple(heard))


def true_alignment(a: str, b: str, wireless: WirelessLog, error: np.ndarray | None = None) -> FrameAlignment:
    T_a_b = se3.inverse(TRUE_FRAMES[a]) @ TRUE_FRAMES[b] @ (np.eye(4) if error is None else error)
    kept = tuple((i, 0) for i, m in enumerate(wireless.measurements) if {m.receiver, m.transmitter} == {a, b})
    return FrameAlignment(a, b, AlignmentHypothesis(T_a_b, 0.0, kept), np.eye(6) * 1e-3, False, "made for a test")


def shared_by(
    odometry: dict[str, Trajectory],
    wireless: WirelessLog,
    alignments: list[FrameAlignment],
    settings: FilterSettings | None = None,
) -> SharedTrajectory:
    chosen = WiClosureFilter(settings)
    return chosen.share(odometry, chosen.gather(odometry, wireless).by_pair, alignments)


def off_by_a_bit() -> np.ndarray:
    return se3.from_yaw(0.15, np.array([3.0, -2.0, 0.0]))


@pytest.mark.parametrize("method", ["joint", "shortest"])
@pytest.mark.parametrize("receiver", ["alpha", "beta"])
@pytest.mark.parametrize("arms", [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((0.3, -0.2, 1.0), (1.0, 0.5, 0.6))])
def test_perfect_input_gives_the_truth(method: str, receiver: str, arms: tuple) -> None:  # type: ignore[type-arg]
    truth, odometry = team(1, ["alpha", "beta"])
    wireless = listen(truth, receiver, "beta" if receiver == "alpha" else "alpha", arms=arms)
    # The rotation of the paper's links is the alignment's: give it the true one there.
    start = off_by_a_bit() if method == "joint" else None
    settings = FilterSettings(shared_trajectory=SharedTrajectorySettings(method=method))
    shared = shared_by(odometry, wireless, [true_alignment("alpha", "beta", wireless, start)], settings)
    p, k = (grid.ravel() for grid in np.indices((150, 150)))
    T_a_b, covariance = shared.estimates["alpha", "beta"].relative_poses("alpha", p, "beta", k)
    expected = se3.between(truth["alpha"].poses[p], truth["beta"].poses[k])
    np.testing.assert_allclose(T_a_b, expected, atol=2e-3)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    for model in shared.estimates["alpha", "beta"].models("alpha", "beta"):
        rows = model.applies(p, k)
        apart = (truth["beta"].positions[k] - truth["alpha"].positions[p])[rows, :2]
        np.testing.assert_allclose(model.displacement(p[rows], k[rows]), apart, atol=2e-3)


def test_tilted_frames_are_found_where_elevations_are_measured() -> None:
    """All six degrees of freedom: beta's odometry does not know which way is up; displacements are spatial."""
    truth, odometry = team(7, ["alpha", "beta"])
    # On a slope that is not flat, or a turn about the plane's axes could not be told.
    lift = np.zeros((150, 4, 4))
    lift[:, 2, 3] = 6.0 * np.sin(np.arange(150) / 15.0)
    truth = {name: Trajectory(name, t.stamps_ns, t.poses + lift, DRIFT) for name, t in truth.items()}
    tilt = se3.exp(np.array([0.2, -0.15, 0.0, 0.0, 0.0, 0.0]))
    frames = {"alpha": np.eye(4), "beta": TRUE_FRAMES["beta"] @ tilt}
    odometry = {name: t.moved(se3.inverse(frames[name])) for name, t in truth.items()}
    wireless = listen(truth, "alpha", "beta") + listen(truth, "beta", "alpha")
    settings = FilterSettings(alignment=AlignmentSettings(gravity_aligned=False))
    kept = tuple((i, 0) for i in range(len(wireless.measurements)))
    guess = frames["beta"] @ off_by_a_bit() @ se3.inverse(tilt) @ se3.exp(np.array([0.15, -0.1, 0, 0, 0, 0]))
    alignment = FrameAlignment("alpha", "beta", AlignmentHypothesis(guess, 0.0, kept), np.eye(6), False, "")
    shared = shared_by(odometry, wireless, [alignment], settings)
    p, k = (grid.ravel() for grid in np.indices((150, 150)))
    (model,) = shared.estimates["alpha", "beta"].models("alpha", "beta")
    assert model.displacement(p, k).shape == (22500, 3)
    apart = truth["beta"].positions[k] - truth["alpha"].positions[p]
    # The priors on tilt and height, centred on the wrong guess, still pull a little.
    assert np.abs(np.linalg.norm(model.displacement(p, k), axis=1) - np.linalg.norm(apart, axis=1)).max() < 0.5


def test_each_pair_has_one_shortest_route() -> None:
    truth, odometry = team(2, ["alpha", "beta"])
    wireless = listen(truth, "alpha", "beta", every=25)
    settings = FilterSettings(shared_trajectory=SharedTrajectorySettings(method="shortest"))
    shared = shared_by(odometry, wireless, [true_alignment("alpha", "beta", wireless)], settings)
    p, k = (grid.ravel() for grid in np.indices((150, 150)))
    models = shared.estimates["alpha", "beta"].models("alpha", "beta")
    answers = np.array([model.applies(p, k) for model in models])
    assert len(models) == 6
    assert (answers.sum(axis=0) == 1).all()


def test_robots_are_joined_through_a_third_and_strangers_stay_apart() -> None:
    truth, odometry = team(3, ["alpha", "beta", "gamma"])
    odometry["delta"] = Trajectory("delta", odometry["alpha"].stamps_ns, winding_road(99), DRIFT)
    wireless = listen(truth, "alpha", "beta") + listen(truth, "beta", "gamma")
    alignments = [true_alignment(a, b, wireless, off_by_a_bit()) for a, b in (("alpha", "beta"), ("beta", "gamma"))]
    shared = shared_by(odometry, wireless, alignments, FilterSettings())
    assert set(shared.estimates) == {("alpha", "beta"), ("alpha", "gamma"), ("beta", "gamma")}
    every = np.arange(150)
    T, C = shared.estimates["alpha", "gamma"].relative_poses("alpha", every, "gamma", every)
    np.testing.assert_allclose(T, se3.between(truth["alpha"].poses, truth["gamma"].poses), atol=5e-3)
    direct = shared.estimates["alpha", "beta"].relative_poses("alpha", every, "beta", every)[1]
    horizontal = [np.median(np.trace(c[:, 3:5, 3:5], axis1=1, axis2=2)) for c in (C, direct)]
    assert horizontal[0] > horizontal[1], "two hops are less certain than one"


def test_an_alignment_that_contradicts_the_others_is_left_out() -> None:
    """Two robots joined twice: through a third, and by links that fit a wrong frame just as well."""
    truth, odometry = team(3, ["alpha", "beta", "gamma"])
    moved = dict(truth, gamma=truth["gamma"].moved(se3.from_yaw(0.8, np.array([60.0, 0.0, 0.0]))))
    wireless = (
        listen(truth, "alpha", "beta") + listen(truth, "beta", "gamma") + listen(moved, "alpha", "gamma", every=30)
    )
    alignments = [true_alignment(a, b, wireless) for a, b in (("alpha", "beta"), ("alpha", "gamma"), ("beta", "gamma"))]
    shared = shared_by(odometry, wireless, alignments, FilterSettings())
    assert any(s.startswith("alpha and gamma: their links contradict") for s in shared.diagnosis)
    every = np.arange(150)
    T, _ = shared.estimates["alpha", "gamma"].relative_poses("alpha", every, "gamma", every)
    np.testing.assert_allclose(T, se3.between(truth["alpha"].poses, truth["gamma"].poses), atol=5e-3)


def test_ambiguous_alignments_join_nobody() -> None:
    truth, odometry = team(4, ["alpha", "beta"])
    wireless = listen(truth, "alpha", "beta")
    certain = true_alignment("alpha", "beta", wireless)
    ambiguous = FrameAlignment("alpha", "beta", certain.best, certain.covariance, True, "two answers")
    assert shared_by(odometry, wireless, [ambiguous], FilterSettings()).estimates == {}


def calibration(factor: float, settings: FilterSettings, every: int = 10, seeds: int = 25) -> tuple[float, float]:
    """Coverage of 90 % intervals, and NEES, with odometry that errs by `factor` times what its drift model says."""
    inside, nees = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        truth, perfect = team(seed, ["alpha", "beta"])
        odometry = {name: replace(drifted(t, rng, DRIFT.scaled(factor)), drift=DRIFT) for name, t in perfect.items()}
        wireless = listen(truth, "alpha", "beta", rng, every, elevation=False)
        alignment = true_alignment("alpha", "beta", wireless, off_by_a_bit())
        shared = shared_by(odometry, wireless, [alignment], settings)
        p, k = rng.integers(0, 150, (2, 400))
        relative, C6 = shared.estimates["alpha", "beta"].relative_poses("alpha", p, "beta", k)
        true_relative = se3.between(truth["alpha"].poses[p], truth["beta"].poses[k])
        error = np.einsum("mji,mj->mi", relative[:, :3, :3], true_relative[:, :3, 3] - relative[:, :3, 3])[:, :2]
        C = C6[:, 3:5, 3:5]
        nees.append(np.einsum("mi,mij,mj->m", error, np.linalg.inv(C), error) / 2)
        inside.append(np.abs(error) < 1.645 * np.sqrt(np.einsum("mii->mi", C)))
    return float(np.mean(inside)), float(np.mean(nees))


def test_predicted_covariance_is_calibrated() -> None:
    """Odometry and radio that err as they say: 90 % intervals hold 85-97 % of the truth, and NEES is near one."""
    coverage, nees = calibration(1.0, FilterSettings())
    assert 0.85 <= coverage <= 0.97
    assert 0.6 <= nees <= 1.5


@pytest.mark.parametrize("factor", [0.3, 6.0])
def test_links_tell_that_the_odometry_is_better_or_worse_than_its_model(factor: float) -> None:
    """Many links tell it; with few the drift is taken to be unknown, not small."""
    coverage, nees = calibration(factor, FilterSettings(), every=2, seeds=8)
    fixed = FilterSettings(shared_trajectory=SharedTrajectorySettings(drift_weight=1e9))
    fixed_coverage, fixed_nees = calibration(factor, fixed, every=2, seeds=8)
    assert abs(coverage - 0.9) < abs(fixed_coverage - 0.9)
    assert abs(np.log(nees)) < abs(np.log(fixed_nees))


def test_false_ranges_do_not_spoil_the_estimate() -> None:
    rng = np.random.default_rng(5)
    truth, odometry = team(5, ["alpha", "beta"])
    clean = listen(truth, "alpha", "beta", rng)
    spoiled = tuple(
        WirelessMeasurement(m.stamp_ns, m.receiver, m.transmitter, (m.range_m or 0) + 30.0, 0.5, m.paths)
        if i % 7 == 3
        else m
        for i, m in enumerate(clean.measurements)
    )
    wireless = WirelessLog(spoiled)
    alignment = true_alignment("alpha", "beta", wireless, off_by_a_bit())
    shared = shared_by(odometry, wireless, [alignment], FilterSettings())
    every = np.arange(150)
    T, _ = shared.estimates["alpha", "beta"].relative_poses("alpha", every, "beta", every)
    error = T[:, :3, 3] - se3.between(truth["alpha"].poses, truth["beta"].poses)[:, :3, 3]
    assert np.median(np.linalg.norm(error[:, :2], axis=1)) < 3.0


def test_headings_narrow_the_yaw() -> None:
    truth, odometry = team(6, ["alpha", "beta"])
    ranges = tuple(
        WirelessMeasurement(m.stamp_ns, m.receiver, m.transmitter, m.range_m, m.range_sigma_m)
        for m in listen(truth, "alpha", "beta").measurements
    )
    headings = tuple(
        Heading(int(t.stamps_ns[i]), name, float(se3.yaw(t.poses[i])), 0.02)
        for name, t in truth.items()
        for i in range(0, 150, 2)
    )
    yaw_sigma = []
    for wireless in (WirelessLog(ranges), WirelessLog(ranges, headings)):
        kept = true_alignment("alpha", "beta", wireless)
        assert kept.best is not None
        kept = FrameAlignment(
            "alpha",
            "beta",
            AlignmentHypothesis(kept.best.T_a_b, 0.0, tuple((i, -1) for i in range(len(ranges)))),
            np.eye(6),
            False,
            "",
        )
        shared = shared_by(odometry, wireless, [kept], FilterSettings())
        _, C = shared.estimates["alpha", "beta"].relative_poses("alpha", np.array([75]), "beta", np.array([75]))
        yaw_sigma.append(np.sqrt(C[0, 2, 2]))
    assert yaw_sigma[1] < yaw_sigma[0]
