from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.registrations import Clouds, Known, Start, Verification
from wiclosure.types import Closure, Decision, Evidence, Float32Array, KeyframeId, Prior

SETTINGS = RegistrationSettings(voxel_size_m=0.5)
PRIOR: Prior = (se3.from_yaw(0.1, np.array([0.5, 0.0, 0.0])), 0.5 * np.eye(6))


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


def proposal(query: int, match: int) -> Closure:
    return Closure(
        KeyframeId("alpha", query),
        KeyframeId("beta", match),
        np.eye(4),
        np.eye(6),
        Evidence(scan_context_distance=0.2, scan_context_yaw=0.05),
        Decision.PROPOSED,
    )


@pytest.fixture(scope="module")
def clouds() -> Clouds:
    return {KeyframeId(robot, k): room(10 * k + (robot == "beta")) for robot in ("alpha", "beta") for k in range(6)}


def test_processes_register_as_one_does(clouds: Clouds) -> None:
    proposed = [(proposal(a, b), PRIOR if a % 2 else None) for a in range(6) for b in range(6)]
    alone = Verification(SETTINGS, clouds).verify(proposed, NoProgress())
    together = Verification(SETTINGS, clouds, jobs=2).verify(proposed, NoProgress())
    assert {r.closure.decision for r in alone} >= {Decision.VERIFIED}
    for (closure, _), one, other in zip(proposed, alone, together, strict=True):
        assert (closure.query, closure.match) == (one.closure.query, one.closure.match)
        assert (one.closure.decision, one.closure.reason) == (other.closure.decision, other.closure.reason)
        np.testing.assert_array_equal(one.closure.T_query_match, other.closure.T_query_match)
        np.testing.assert_array_equal(one.closure.covariance, other.closure.covariance)
        np.testing.assert_array_equal(astuple(one.closure.evidence), astuple(other.closure.evidence))


def test_a_closure_is_registered_once_from_each_start(clouds: Clouds) -> None:
    known: Known = {}
    verification = Verification(SETTINGS, clouds, known)
    first = verification.verify(
        [(proposal(0, 0), PRIOR), (proposal(0, 0), PRIOR), (proposal(0, 0), None)], NoProgress()
    )
    assert len(known) == 2
    assert first[0] is first[1] is not first[2]
    again = Verification(SETTINGS, clouds, known).verify([(proposal(0, 0), None)], NoProgress())
    assert again[0] is first[2]


def test_the_start_holds_all_that_a_registration_depends_on() -> None:
    elsewhere = (se3.from_yaw(0.2, np.zeros(3)), PRIOR[1])
    vaguer = (PRIOR[0], 2 * PRIOR[1])
    starts = {Start.of(proposal(0, 1), prior) for prior in (None, PRIOR, elsewhere, vaguer)}
    assert len(starts | {Start.of(proposal(1, 1), PRIOR), Start.of(proposal(0, 2), PRIOR)}) == 6
    np.testing.assert_array_equal(Start.of(proposal(0, 1), PRIOR).row[1:17].reshape(4, 4), PRIOR[0])
