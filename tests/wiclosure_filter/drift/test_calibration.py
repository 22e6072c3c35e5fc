"""Constant errors of radio and odometry are found where the measurements tell them, and carried where they do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import Calibration, FloatArray
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.drift.calibration import BIAS, CLOCK, COUNT, SystematicErrors
from wiclosure.wiclosure_filter.drift.error_prior import ErrorPrior

DRIFT = DriftModel(translation_walk=0.01, rotation_walk=1e-4, rotation_walk_turning=1e-4)


def found(alignment: object, name: str) -> Calibration:
    (one,) = [one for one in alignment.calibration if one.name.startswith(name)]
    return one


def test_a_range_bias_is_measured_where_the_robots_come_near(make_case: Callable[..., object]) -> None:
    near, far = (make_case("reciprocal", heard=40, drift=DRIFT, seed=seed) for seed in (5, 2))  # 17 and 63 m apart
    for case, told in ((near, True), (far, False)):
        alignment = align(replace(case.links, range_m=case.links.range_m + 0.5), case.trajectories, case.settings)
        bias = found(alignment, "range bias")
        assert bias.measured[0] == pytest.approx(0.5, abs=0.1)
        assert (bias.sigma < 0.5 * bias.prior_sigma) == told
        assert not alignment.ambiguous


def test_an_array_that_is_mounted_turned_is_a_fault(make_case: Callable[..., object]) -> None:
    case = make_case("one-way", heard=40, drift=DRIFT)
    turned = se3.wrap_angle(case.links.azimuth + 0.3)
    alignment = align(replace(case.links, azimuth=turned), case.trajectories, case.settings)
    assert found(alignment, "azimuth offset of a").measured[0] == pytest.approx(0.3, abs=0.05)
    assert alignment.ambiguous
    assert "azimuth offset of a" in alignment.suspected_fault


def test_stretched_odometry_is_measured(make_case: Callable[..., object]) -> None:
    def stretched(poses: FloatArray) -> FloatArray:
        poses = poses.copy()
        poses[:, :3, 3] *= 1.04
        return poses

    alignment_of = [
        align(case.links, case.trajectories, case.settings)
        for case in (make_case(heard=40, drift=DRIFT), make_case(heard=40, drift=DRIFT, odometry_of_b=stretched))
    ]
    straight, longer = (found(alignment, "scale error of the odometry of b") for alignment in alignment_of)
    assert straight.measured[0] == pytest.approx(0.0, abs=0.01)
    assert longer.measured[0] == pytest.approx(-0.04, abs=0.015)


def test_what_nothing_tells_keeps_its_prior_and_widens_the_covariance(make_case: Callable[..., object]) -> None:
    case = make_case("range-only", heard=40, drift=DRIFT)
    narrow = case.settings.model_copy(
        update={"calibration": CalibrationPriors(range_bias_m=1e-4, range_scale=1e-4, clock_s=1e-4, scale=1e-4)}
    )
    wide = align(case.links, case.trajectories, case.settings)
    sure = align(case.links, case.trajectories, narrow)
    mounting = found(wide, "azimuth offset of a")
    assert mounting.sigma == pytest.approx(mounting.prior_sigma * np.sqrt(0.98 + 0.02 * 10**2), rel=1e-3)
    assert np.trace(wide.covariance[3:, 3:]) > np.trace(sure.covariance[3:, 3:])
    assert (np.linalg.eigvalsh(wide.covariance) > 0).all()


def test_correcting_undoes_the_errors(make_case: Callable[..., object]) -> None:
    case = make_case("reciprocal", heard=20)
    errors = SystematicErrors.of(
        case.problem.observations, case.problem.odometry, ErrorPrior.of(CalibrationPriors()).usual
    )
    same = errors.corrected(np.zeros(COUNT))
    np.testing.assert_allclose(same.direction, case.problem.observations.direction)
    value = np.zeros(COUNT)
    value[BIAS], value[CLOCK] = 0.4, 0.5
    corrected = errors.corrected(value)
    np.testing.assert_allclose(corrected.range_m, case.problem.observations.range_m - 0.4)
    np.testing.assert_allclose(corrected.b - same.b, 0.5 * errors.velocity_b)


def test_a_blunder_of_which_the_prior_keeps_the_estimate_is_likely() -> None:
    # 3 m are measured to 0.6 m, and the prior of 0.3 m leaves 0.6 m of them: 3.6 usual sizes, or one of a blunder.
    assert Calibration("range bias", "m", 0.6, 0.268, 0.3, 0.3).log_blunder > 3.0
    assert Calibration("range bias", "m", 0.06, 0.268, 0.3, 0.3).log_blunder <= 0.0
    assert Calibration("range bias", "m", 0.7, 0.1, 0.3, 0.3).log_blunder == 0.0  # the estimate has followed


def test_extraordinary_errors_are_far_beyond_prior_and_sigma() -> None:
    assert Calibration("range bias", "m", 1.0, 0.1, 0.3, 0.3).extraordinary
    assert not Calibration("range bias", "m", 0.8, 0.1, 0.3, 0.3).extraordinary
    value, sigma = Calibration("range bias", "m", 0.5, 0.15, 0.3, 0.3).measured
    assert value == pytest.approx(0.5 / 0.75)
    assert sigma == pytest.approx(0.15 / np.sqrt(0.75))


def test_an_error_that_nothing_tells_of_is_said_to_be_untold() -> None:
    told = Calibration("range bias", "m", 0.55, 0.08, 0.3, 0.3)
    assert str(told) == "range bias: 0.59 m, sigma 0.08"
    assert str(Calibration("azimuth offset of a", "rad", 0.0, 0.05, 0.05, 0.05)).endswith(
        "not told by the measurements"
    )
