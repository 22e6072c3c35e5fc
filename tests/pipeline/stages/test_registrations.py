from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.pipeline.runtime.processes import Processes
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.registrations import Clouds, KnownRegistrations, Registered, RegistrationPool, Start
from wiclosure.types import (
    Closure,
    Float32Array,
    KeyframeId,
    Prediction,
    PredictionKind,
    ScanContextMatch,
    Stage,
    survivors,
)

SETTINGS = RegistrationSettings(voxel_size_m=0.5)
PREDICTED = Prediction(se3.from_yaw(0.1, np.array([0.5, 0.0, 0.0])), 0.5 * np.eye(6), PredictionKind.POSE)


def room(seed: int) -> Float32Array:
    """Points on the walls and the floor of a room with a niche."""
    rng = np.random.default_rng(seed)
    wall = rng.uniform(-1, 1, (3000, 2))
    side = rng.integers(0, 4, 3000)
    xy = np.choose(side[:, None] == [[0, 1]], [wall[:, :1] * [[9.0, 6.0]], np.array([[9.0, 6.0]])])
    xy[side > 1] *= -1
    walls = np.column_stack([xy, 2.0 * wall[:, 1]])
    niche = np.column_stack([rng.uniform(4, 7, 600), np.full(600, 3.0), rng.uniform(-2, 2, 600)])
    return np.concatenate([walls, niche]).astype(np.float32)


def proposal(query: int, match: int, prediction: Prediction | None = None, distance: float = 0.2) -> Closure:
    ends = KeyframeId("alpha", query), KeyframeId("beta", match)
    return Closure(*ends, prediction=prediction, scan_context=ScanContextMatch(distance, 0.05))


@pytest.fixture(scope="module")
def clouds() -> Clouds:
    return {KeyframeId(robot, k): room(10 * k + (robot == "beta")) for robot in ("alpha", "beta") for k in range(6)}


def test_processes_register_as_one_does(clouds: Clouds) -> None:
    proposed = [proposal(a, b, PREDICTED if a % 2 else None) for a in range(6) for b in range(6)]
    alone, _ = RegistrationPool(SETTINGS, clouds).register(proposed, NoProgress())
    together, _ = RegistrationPool(SETTINGS, clouds, workers=Processes(2)).register(proposed, NoProgress())
    assert survivors(alone, Stage.REGISTRATION)
    for closure, one, other in zip(proposed, alone, together, strict=True):
        assert (closure.query, closure.match) == (one.query, one.match)
        assert (one.rejected_at, one.reason, one.evidence) == (other.rejected_at, other.reason, other.evidence)
        assert one.measured is not None
        assert other.measured is not None
        np.testing.assert_array_equal(one.measured.T_query_match, other.measured.T_query_match)
        np.testing.assert_array_equal(one.measured.covariance, other.measured.covariance)


def test_a_closure_is_registered_once_from_each_start(clouds: Clouds) -> None:
    known: KnownRegistrations = {}
    pool = RegistrationPool(SETTINGS, clouds, known)
    first, first_s = pool.register([proposal(0, 0, PREDICTED), proposal(0, 0, PREDICTED), proposal(0, 0)], NoProgress())
    assert len(known) == 2
    assert first[0].measured is first[1].measured is not first[2].measured
    seconds = [registered.seconds for registered in known.values()]
    assert first_s == pytest.approx(2 * seconds[0] + seconds[1])
    again, again_s = RegistrationPool(SETTINGS, clouds, known).register([proposal(0, 0)], NoProgress())
    assert again[0].measured is first[2].measured
    assert again_s == seconds[1]


def test_what_is_known_of_a_start_applies_to_a_closure_that_looks_otherwise(clouds: Clouds) -> None:
    known: KnownRegistrations = {}
    pool = RegistrationPool(SETTINGS, clouds, known)
    (first,), _ = pool.register([proposal(0, 0)], NoProgress())
    (second,), _ = pool.register([proposal(0, 0, distance=0.3)], NoProgress())
    assert len(known) == 1
    assert second.scan_context == ScanContextMatch(0.3, 0.05)
    assert (second.measured, second.passed, second.reason) == (first.measured, first.passed, first.reason)


def test_a_closure_with_too_little_to_register_stays_unmeasured() -> None:
    refused = proposal(0, 0).rejected(Stage.REGISTRATION, "only 3 points of one cloud stand on the ground")
    again = Registered.of(refused, 0.1).applied_to(proposal(0, 0))
    assert (again.measured, again.rejected_at, again.reason) == (None, Stage.REGISTRATION, refused.reason)


def test_the_start_holds_all_that_a_registration_depends_on() -> None:
    elsewhere = Prediction(se3.from_yaw(0.2, np.zeros(3)), PREDICTED.covariance, PredictionKind.POSE)
    vaguer = PREDICTED.widened(2.0)
    heading = Prediction(PREDICTED.T_query_match, PREDICTED.covariance, PredictionKind.HEADING)
    predictions = (None, PREDICTED, elsewhere, vaguer, heading)
    starts = {Start.of(proposal(0, 1, prediction)) for prediction in predictions}
    starts |= {Start.of(proposal(1, 1, PREDICTED)), Start.of(proposal(0, 2, PREDICTED))}
    assert len(starts) == 7
    assert len(starts | {Start.of(Closure(KeyframeId("alpha", 0), KeyframeId("beta", 1)))}) == 8
    row = Start.of(proposal(0, 1, PREDICTED)).row
    np.testing.assert_array_equal(row[1:17].reshape(4, 4), PREDICTED.T_query_match)
    np.testing.assert_array_equal(row[17:53].reshape(6, 6), PREDICTED.covariance)
