from __future__ import annotations

from pathlib import Path

import numpy as np

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.front_end_result import Descriptors, FrontEndCounts, OdometryResult
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.stages.registration_store import RegistrationStore
from wiclosure.pipeline.stages.registrations import KnownRegistrations, Registered, Start
from wiclosure.types import KeyframeId, Measured, RegistrationEvidence


def front(robot: str, shift_m: float = 0.0) -> FrontEndResult:
    clouds = tuple(np.random.default_rng(k).normal(shift_m, 1, (5, 3)).astype(np.float32) for k in range(2))
    followed = OdometryResult(
        np.array([1, 2]) * 10**9,
        np.array([1, 2]) * 10**9,
        np.tile(np.eye(4), (2, 1, 1)),
        np.array([0, 1]),
        clouds,
        FrontEndCounts(2),
        0.0,
        0.0,
    )
    return FrontEndResult.of(robot, DriftModel(), followed, Descriptors(np.zeros((2, 3, 4), np.float32), 0.0))


def start(number: float) -> Start:
    return Start(KeyframeId("alpha", 0), KeyframeId("beta", 1), np.full(54, number).tobytes())


def measured(chi2: float | None, rms_m: float = 0.1) -> Measured:
    evidence = RegistrationEvidence(120, 0.5, 0.97, rms_m, chi2)
    return Measured(se3.from_yaw(0.3, np.array([1.0, 2.0, 3.0])), 0.1 * np.eye(6), evidence)


KNOWN: KnownRegistrations = {
    start(1.0): Registered(measured(2.5), True, "it fits", 0.25),
    start(np.nan): Registered(measured(None), False, "ambiguous: ä", 0.5),
    start(2.0): Registered(None, False, "only 3 points", 0.125),
    start(3.0): Registered(measured(7.0, np.nan), False, "nothing matches", 0.125),
}


def test_registrations_come_back_as_they_were_for_the_same_clouds_and_settings_only(tmp_path: Path) -> None:
    cache, settings = StageCache(tmp_path), RegistrationSettings()
    fronts = {robot: front(robot) for robot in ("alpha", "beta")}
    RegistrationStore(cache, fronts, settings).keep(KNOWN)
    known: KnownRegistrations = {}
    assert RegistrationStore(cache, fronts, settings).recall(known) == 4
    assert known.keys() == KNOWN.keys()
    for key, expected in KNOWN.items():
        found = known[key]
        assert (found.accepted, found.reason, found.seconds) == (expected.accepted, expected.reason, expected.seconds)
        assert (found.measured is None) == (expected.measured is None)
        if found.measured is not None and expected.measured is not None:
            np.testing.assert_array_equal(found.measured.T_query_match, expected.measured.T_query_match)
            np.testing.assert_array_equal(found.measured.covariance, expected.measured.covariance)
            assert repr(found.measured.evidence) == repr(expected.measured.evidence)  # NaN equals nothing
    # Threads and memory change nothing; other clouds and thresholds do.
    same = settings.model_copy(update={"num_threads": 2, "cached_clouds": 5})
    assert RegistrationStore(cache, fronts, same).recall({}) == 4
    assert RegistrationStore(cache, fronts | {"beta": front("beta", 0.1)}, settings).recall({}) == 0
    other = settings.model_copy(update={"min_inliers": 50})
    assert RegistrationStore(cache, fronts, other).recall({}) == 0


def test_damaged_registrations_are_done_again(tmp_path: Path) -> None:
    store = RegistrationStore(StageCache(tmp_path), {"alpha": front("alpha")}, RegistrationSettings())
    store.keep(KNOWN)
    (entry,) = tmp_path.iterdir()
    content = bytearray(entry.read_bytes())
    content[len(content) // 2] ^= 0xFF
    entry.write_bytes(content)
    assert store.recall({}) == 0
    store.keep(KNOWN)
    assert store.recall({}) == 4


def test_without_a_cache_nothing_is_kept() -> None:
    store = RegistrationStore(StageCache(None), {"alpha": front("alpha")}, RegistrationSettings())
    store.keep(KNOWN)
    assert store.recall({}) == 0
