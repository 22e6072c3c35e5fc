"""A frame transform that follows the drift of the odometry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.alignment.drifting_frames import BandedSystem, drift_matters, follow_drift
from wiclosure.wiclosure_filter.alignment.refinement import climb

DRIFT = DriftModel(translation_walk=0.01, rotation_walk=0.02)


def turning(rate_rad: float) -> Callable[[FloatArray], FloatArray]:
    """Odometry whose every step turns by a little too much."""

    def drifted(poses: FloatArray) -> FloatArray:
        out = [poses[0]]
        for step in se3.between(poses[:-1], poses[1:]) @ se3.from_yaw(rate_rad, np.zeros(3)):
            out.append(out[-1] @ step)
        return np.array(out)

    return drifted


@pytest.mark.parametrize("kind", ["heading", "reciprocal", "one-way"])
def test_without_drift_the_truth_stays(kind: str, make_case: Callable[..., object]) -> None:
    case = make_case(kind, drift=DRIFT)
    mixture, drift = case.problem.anchored_at(5)
    frames = follow_drift(case.state, mixture, drift, case.problem.prior, case.problem.odometry)
    np.testing.assert_allclose(frames.state, case.state, atol=1e-3)
    np.testing.assert_allclose(frames.yaw, case.state[0], atol=1e-3)
    true = se3.transform(case.T_a_b, case.links.antenna_b) - case.links.antenna_a
    np.testing.assert_allclose(frames.w, true, atol=1e-2)
    assert (np.linalg.eigvalsh(frames.covariance) > 0).all()


def test_the_yaw_follows_an_odometry_that_turns(make_case: Callable[..., object]) -> None:
    """b's odometry turns by 0.6 rad too much on its way: no rigid transform explains that, a chain does."""
    still = make_case("reciprocal", heard=30)
    case = make_case("reciprocal", heard=30, drift=DRIFT, odometry_of_b=turning(0.01))
    mixture, drift = case.problem.anchored_at(30)
    rigid = climb(case.state[None], mixture, case.problem.prior).states[0]
    frames = follow_drift(rigid, mixture, drift, case.problem.prior, case.problem.odometry)
    expected = case.state[0] - 0.01 * case.problem.observations.index_b
    assert np.abs(frames.yaw - expected).max() < 0.1  # most at the ends, where a walk is taken to stop
    assert np.abs(frames.yaw - expected)[15:45].max() < 0.02
    assert np.abs(rigid[0] - expected).max() > 0.2
    true = se3.transform(still.T_a_b, still.links.antenna_b) - still.links.antenna_a
    assert np.linalg.norm(frames.w - true, axis=1).max() < 0.7
    assert frames.explanation.ranged().all()
    assert frames.middle in np.flatnonzero(np.abs(case.problem.observations.index_a - 30) < 3)


def test_drift_matters_over_long_distances_only(make_case: Callable[..., object]) -> None:
    short, long = make_case(), make_case(drift=DriftModel(translation_walk=0.3, rotation_walk=0.01))
    assert not drift_matters(short.problem.anchored_at(0)[1], short.problem.observations)
    assert drift_matters(long.problem.anchored_at(0)[1], long.problem.observations)
    one = make_case(heard=1, drift=DriftModel(translation_walk=0.3, rotation_walk=0.01))
    assert not drift_matters((np.array([9.0]), np.array([9.0])), one.problem.observations)


def test_the_banded_system_is_the_dense_one() -> None:
    rng = np.random.default_rng(0)
    diagonal = rng.normal(size=(5, 4, 4))
    diagonal = diagonal @ np.swapaxes(diagonal, 1, 2) + 20 * np.eye(4)
    upper, gradient = rng.normal(size=(4, 4, 4)), rng.normal(size=(5, 4))
    dense = np.zeros((20, 20))
    for m in range(5):
        dense[4 * m : 4 * m + 4, 4 * m : 4 * m + 4] = diagonal[m]
    for m in range(4):
        dense[4 * m : 4 * m + 4, 4 * m + 4 : 4 * m + 8] = upper[m]
        dense[4 * m + 4 : 4 * m + 8, 4 * m : 4 * m + 4] = upper[m].T
    system = BandedSystem(diagonal, upper, gradient)
    np.testing.assert_allclose(system.solved(), np.linalg.solve(dense, gradient.ravel()))
    np.testing.assert_allclose(system.marginal(2), np.linalg.inv(dense)[8:12, 8:12], atol=1e-12)
