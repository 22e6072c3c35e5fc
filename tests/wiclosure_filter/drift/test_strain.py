"""How far measurements bend odometry, and the step that is to blame."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.consensus.refinement import climb
from wiclosure.wiclosure_filter.drift.drifting_frames import DriftingFrames, RigidTransform, follow_drifts

DRIFT = DriftModel(translation_walk=0.05, rotation_walk=0.005)
AT = 30


def jumped(metres: float) -> Callable[[FloatArray], FloatArray]:
    """Odometry that misses a move sideways half-way."""

    def slipped(poses: FloatArray) -> FloatArray:
        poses = poses.copy()
        missed = se3.from_yaw(0.0, np.array([0.0, metres, 0.0]))
        poses[AT:] = poses[AT] @ missed @ se3.inverse(poses[AT]) @ poses[AT:]
        return poses

    return slipped


def frames_of(rigid: RigidTransform) -> DriftingFrames:
    (frames,) = follow_drifts([rigid])
    assert frames is not None
    return frames


def followed(make_case: Callable[..., object], metres: float, heard: int = 30) -> DriftingFrames:
    case = make_case("reciprocal", heard=heard, drift=DRIFT, odometry_of_b=jumped(metres))
    mixture, drift = case.problem.anchored_at(heard // 2)
    rigid = climb(case.state[None], mixture, case.problem.prior).states[0]
    return frames_of(
        RigidTransform(rigid, mixture, drift, case.problem.prior, case.problem.odometry, CalibrationPriors())
    )


def test_without_a_slip_nothing_is_bent(make_case: Callable[..., object]) -> None:
    strain = followed(make_case, 0.0).strain
    assert strain.squared < 0.1 * strain.determined
    assert strain.probability(1.0) > 0.99
    assert strain.slip(20.0) == ""


@pytest.mark.parametrize("metres", [3.0])
def test_a_slip_bends_the_step_where_it_is(make_case: Callable[..., object], metres: float) -> None:
    frames = followed(make_case, metres)
    strain = frames.strain
    assert strain.probability(1.0) < 1e-3
    at = int(np.argmax(strain.slips))
    stamps_s = (strain.stamp_ns - strain.stamp_ns[0]) / 1e9
    assert stamps_s[at] <= AT <= stamps_s[at + 1] + 2
    assert "odometry seems to slip" in strain.slip(20.0)


def test_what_is_determined_is_what_simulated_noise_bends(make_case: Callable[..., object]) -> None:
    """Mean of the squares over draws of odometry noise; measurements are free of noise, so the rest is a bound."""
    squares, determined = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)

        def noisy(poses: FloatArray, rng: np.random.Generator = rng) -> FloatArray:
            sigma = np.zeros((len(poses) - 1, 6))
            sigma[:, 2], sigma[:, 3:5] = DRIFT.rotation_walk, DRIFT.translation_walk
            out = [poses[0]]
            for step in se3.between(poses[:-1], poses[1:]) @ se3.exp(sigma * rng.normal(size=sigma.shape)):
                out.append(out[-1] @ step)
            return np.array(out)

        case = make_case("reciprocal", heard=20, seed=seed, drift=DRIFT, odometry_of_b=noisy)
        mixture, drift = case.problem.anchored_at(10)
        problem, calibration = case.problem, CalibrationPriors()
        frames = frames_of(RigidTransform(case.state, mixture, drift, problem.prior, problem.odometry, calibration))
        squares.append(frames.strain.squared)
        determined.append(frames.strain.determined)
    assert 0.1 * np.mean(determined) < np.mean(squares) < np.mean(determined)
