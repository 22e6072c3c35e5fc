from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration.methods import METHODS
from wiclosure.frontends.registration.registration import Registration
from wiclosure.types import (
    Closure,
    Float32Array,
    FloatArray,
    KeyframeId,
    Measured,
    Prediction,
    PredictionKind,
    RegistrationEvidence,
    ScanContextMatch,
    Stage,
)

VAGUE = np.diag(np.square([0.03, 0.03, np.radians(10), 2.0, 2.0, 0.5]))


def proposed(prediction: tuple[FloatArray, FloatArray] | None = None, yaw_rad: float | None = None) -> Closure:
    return Closure(
        KeyframeId("alpha", 0),
        KeyframeId("beta", 0),
        prediction=None if prediction is None else Prediction(*prediction, PredictionKind.POSE),
        scan_context=None if yaw_rad is None else ScanContextMatch(0.2, yaw_rad),
        overlap_probability=0.7,
    )


def measured(closure: Closure) -> tuple[Measured, RegistrationEvidence]:
    assert closure.measured is not None
    assert closure.measured.evidence is not None
    return closure.measured, closure.measured.evidence


def house(centre: tuple[float, float], size: tuple[float, float], rng: np.random.Generator) -> FloatArray:
    """Points on four walls, 8 m high."""
    side = rng.integers(0, 4, 1500)
    along, height = rng.uniform(-0.5, 0.5, 1500), rng.uniform(-1.7, 6.3, 1500)
    x = np.choose(side, [along, along, np.full(1500, -0.5), np.full(1500, 0.5)]) * size[0]
    y = np.choose(side, [np.full(1500, -0.5), np.full(1500, 0.5), along, along]) * size[1]
    return np.column_stack([x + centre[0], y + centre[1], height])


def seen_from(T_world_body: FloatArray, world: FloatArray, range_m: float = 45.0) -> Float32Array:
    body = se3.transform(se3.inverse(T_world_body), world)
    return body[np.linalg.norm(body, axis=1) < range_m].astype(np.float32)


def street(seed: int) -> FloatArray:
    """A street of unlike houses with ground."""
    rng = np.random.default_rng(seed)
    houses = [
        house((x + rng.uniform(-3, 3), side * rng.uniform(10, 16)), (rng.uniform(6, 12), rng.uniform(6, 10)), rng)
        for x in range(-50, 60, 15)
        for side in (-1, 1)
    ]
    ground = np.column_stack([rng.uniform(-60, 60, (9000, 2)), np.full(9000, -1.7)])
    return np.concatenate([*houses, ground]) + rng.normal(0, 0.02, (len(houses) * 1500 + 9000, 3))


def terrace(seed: int) -> FloatArray:
    """A street of equal houses 12 m apart: the same again after every house."""
    rng = np.random.default_rng(seed)
    one = np.concatenate([house((0, 10), (8, 8), rng), house((3, -11), (6, 8), rng)])
    return np.concatenate([one + np.array([x, 0, 0]) for x in range(-120, 132, 12)])


def errors(T_a: FloatArray, T_b: FloatArray) -> tuple[float, float]:
    """Metres and degrees between two transforms."""
    gap = se3.between(T_a, T_b)
    return float(np.linalg.norm(gap[:3, 3])), float(np.degrees(se3.rotation_angle(gap)))


TRUTH = se3.from_yaw(0.6, np.array([5.0, -2.0, 0.1]))


@pytest.mark.parametrize("method", sorted(METHODS))
def test_every_method_measures_a_true_closure_and_says_why_it_accepts_it(method: str) -> None:
    registration = Registration(RegistrationSettings(method=method))  # type: ignore[arg-type]  # the registry's keys
    world = street(0)
    start = TRUTH @ se3.from_yaw(0.02, np.array([0.3, 0.2, 0.0]))
    before = proposed((start, VAGUE))
    after = registration.verify(before, seen_from(np.eye(4), world), seen_from(TRUTH, world))
    assert after.live, after.reason
    found, evidence = measured(after)
    metres, degrees = errors(TRUTH, found.T_query_match)
    assert (metres < 0.25, degrees < 1.0) == (True, True)
    assert after.reason
    assert (after.query, after.match) == (before.query, before.match)
    assert (after.prediction, after.overlap_probability) == (before.prediction, before.overlap_probability)
    assert evidence.inliers > 0
    assert 0 < evidence.inlier_ratio <= 1
    assert 0 < evidence.agreement <= 1
    assert evidence.prediction_chi2 is not None
    np.testing.assert_allclose(found.covariance, found.covariance.T)
    assert np.linalg.eigvalsh(found.covariance).min() > 0


@pytest.mark.parametrize("method", sorted(METHODS))
def test_every_method_refuses_clouds_with_nothing_in_common(method: str) -> None:
    registration = Registration(RegistrationSettings(method=method, max_fitness_m2=0.05))  # type: ignore[arg-type]  # as above
    rng = np.random.default_rng(0)
    wall = np.column_stack([rng.uniform(-20, 20, 4000), np.full(4000, 30.0), rng.uniform(0, 15, 4000)])
    after = registration.verify(proposed(), seen_from(np.eye(4), street(0)), wall.astype(np.float32))
    assert after.rejected_at is Stage.REGISTRATION
    assert after.reason


def test_without_a_prediction_the_turned_scan_is_found_although_scan_context_errs() -> None:
    world, truth = street(1), se3.from_yaw(2.5, np.array([4.0, 1.0, 0.0]))
    after = Registration().verify(proposed(yaw_rad=0.9), seen_from(np.eye(4), world), seen_from(truth, world))
    assert after.live, after.reason
    assert max(errors(truth, measured(after)[0].T_query_match)) < 0.2


def test_in_a_street_of_equal_houses_the_prediction_decides() -> None:
    world = terrace(0)
    query, match = seen_from(np.eye(4), world), seen_from(se3.from_yaw(0.1, np.array([3.0, 0.0, 0.0])), world)
    truth = se3.from_yaw(0.1, np.array([3.0, 0.0, 0.0]))
    a_house_off = se3.from_yaw(0.1, np.array([15.0, 0.0, 0.0]))
    # A vague prediction leaves two houses to choose from: the better one is chance.
    slid = Registration().verify(proposed((a_house_off, VAGUE)), query, match)
    assert slid.rejected_at is Stage.REGISTRATION
    assert slid.reason.startswith("ambiguous: a pose 12.0 m and 0 degrees away")
    # A surer prediction decides ...
    sure = np.diag(np.square([0.02, 0.02, 0.02, 0.2, 0.2, 0.2]))
    near = truth @ se3.from_yaw(0.0, np.array([0.3, 0, 0]))
    found = Registration().verify(proposed((near, sure)), query, match)
    assert found.live, found.reason
    assert max(errors(truth, measured(found)[0].T_query_match)) < 0.2
    # ... and one from which the nearest house is many standard deviations away is contradicted by it.
    between = se3.from_yaw(0.1, np.array([12.5, 0.0, 0.0]))
    refused = Registration().verify(proposed((between, sure)), query, match)
    assert refused.rejected_at is Stage.REGISTRATION
    assert refused.reason.startswith("contradicts the prediction")
    chi2 = measured(refused)[1].prediction_chi2
    assert chi2 is not None
    assert chi2 > Registration().chi2_limit


def test_a_measurement_that_states_no_exactness_is_held_against_a_prediction_all_the_same() -> None:
    """The variance of DiSCo-SLAM's registration is its fitness on every axis, of metres and of radians."""
    world = street(0)
    registration = Registration(RegistrationSettings(method="point-to-point", max_fitness_m2=100.0))
    sure = np.diag(np.square([0.02, 0.02, 0.02, 0.2, 0.2, 0.2]))
    elsewhere = TRUTH @ se3.from_yaw(0.0, np.array([6.0, 0.0, 0.0]))
    closure = proposed((elsewhere, sure))
    after = registration.verify(closure, seen_from(np.eye(4), world), seen_from(TRUTH, world))
    assert np.linalg.norm(se3.between(elsewhere, measured(after)[0].T_query_match)[:3, 3]) > 2.0
    assert after.rejected_at is Stage.REGISTRATION
    assert after.reason.startswith("contradicts the prediction")


def test_a_pose_with_a_house_where_one_sensor_saw_free_space_is_refused() -> None:
    rng = np.random.default_rng(0)
    wall = np.column_stack([rng.uniform(-30, 30, 9000), np.full(9000, 15.0), rng.uniform(-1.5, 8, 9000)])
    side = np.column_stack([np.full(3000, -25.0), rng.uniform(-15, 15, 3000), rng.uniform(-1.5, 8, 3000)])
    kiosk = np.column_stack([rng.uniform(-9, 9, 6000), np.full(6000, 6.0), rng.uniform(-1.5, 3, 6000)])
    without = (np.concatenate([wall, side]) + rng.normal(0, 0.02, (12000, 3))).astype(np.float32)
    hides = (np.abs(without[:, 0]) < 1.5 * without[:, 1]) & (without[:, 1] > 7) & (without[:, 2] < 0.5 * without[:, 1])
    with_kiosk = np.concatenate([without[~hides], kiosk.astype(np.float32)])
    alike = Registration().verify(proposed((np.eye(4), VAGUE)), without, without)
    assert alike.live, alike.reason
    unlike = Registration().verify(proposed((np.eye(4), VAGUE)), without, with_kiosk)
    assert unlike.rejected_at is Stage.REGISTRATION
    assert unlike.reason.startswith("free-space conflict")


def test_a_cloud_of_bare_ground_is_refused() -> None:
    ground = np.column_stack([np.random.default_rng(0).uniform(-30, 30, (5000, 2)), np.full(5000, -1.7)])
    after = Registration().verify(proposed(), ground.astype(np.float32), ground.astype(np.float32))
    assert after.rejected_at is Stage.REGISTRATION
    assert "nothing to hold on to" in after.reason


@pytest.mark.parametrize("points", [0, 1, 5])
def test_clouds_of_hardly_any_points_are_refused(points: int) -> None:
    few = np.random.default_rng(0).uniform(-5, 5, (points, 3)).astype(np.float32)
    after = Registration().verify(proposed(), few, seen_from(np.eye(4), street(0)))
    assert after.rejected_at is Stage.REGISTRATION


def test_the_covariance_is_widest_along_a_corridor_in_the_frame_of_the_match() -> None:
    rng = np.random.default_rng(0)
    walls = np.column_stack([rng.uniform(-25, 25, 9000), rng.choice([-3.0, 3.0], 9000), rng.uniform(-1.5, 2, 9000)])
    ends = np.column_stack([rng.choice([-25.0, 25.0], 250), rng.uniform(-3, 3, 250), rng.uniform(-1.5, 2, 250)])
    corridor = np.concatenate([walls, ends]) + rng.normal(0, 0.02, (9250, 3))
    truth = se3.from_yaw(np.pi / 2, np.array([1.0, 0.5, 0.0]))  # the match looks across the corridor
    closure = proposed((truth, VAGUE))
    after = Registration().verify(closure, seen_from(np.eye(4), corridor), seen_from(truth, corridor))
    sigma_x, sigma_y, _ = np.sqrt(np.diag(measured(after)[0].covariance)[3:])
    assert sigma_y > 1.02 * sigma_x
