"""Ways of putting two robots together, with registrations of which it is known how well they fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from wiclosure import se3
from wiclosure.frontends.registration.floor_plans import LookAlike
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.rivals.other_ways import MergedPair, OtherWay
from wiclosure.types import Closure, FloatArray, Measured, RegistrationEvidence, Stage, Trajectory

ALONG_M = np.linspace(-10.0, 10.0, 40)
CROSSING = se3.from_yaw(0.45, np.zeros(3))

Fit = Callable[[Closure, float], float]
"""Share of the structure that matches, by keyframes and their distance in m."""


def less_the_farther(closure: Closure, apart_m: float) -> float:
    return float(0.95 * np.exp(-apart_m / 6.0))


def pair() -> MergedPair:
    """In the map one path runs along the other; the other way has them cross."""

    def path(robot: str, beside_m: float) -> Trajectory:
        at = np.column_stack([ALONG_M, 0 * ALONG_M + beside_m, 0 * ALONG_M])
        return Trajectory(robot, np.arange(len(at)) * 10**9, se3.from_yaw(np.zeros(len(at)), at))

    return MergedPair(("a", "b"), (path("a", 0.0), path("b", 0.1)), [LookAlike(CROSSING, 0.95)], 0.25, Config())


def found(fit: Fit, off: FloatArray | None = None) -> list[OtherWay]:
    def register(proposed: Sequence[Closure]) -> list[Closure]:
        return [registered(closure) for closure in proposed]

    def registered(closure: Closure) -> Closure:
        assert closure.prediction is not None
        T = closure.prediction.T_query_match
        share = fit(closure, float(np.linalg.norm(T[:3, 3])))
        evidence = RegistrationEvidence(1000, share, 0.99, 0.05)
        measured = Measured(T if off is None else T @ off, np.eye(6) * 1e-4, evidence)
        return closure.measured_as(measured).accepted(Stage.REGISTRATION)

    return list(pair().other_ways(register))


def test_keyframes_that_lie_farther_apart_are_no_worse_for_that() -> None:
    """Those that the map brings together lie within decimetres, those of the crossing up to 5 m apart."""
    (way,) = found(less_the_farther)
    apart_m = [np.linalg.norm(c.measured.T_query_match[:3, 3]) for c in way.agreeing if c.measured]
    assert np.median(apart_m) > 2.0
    assert 0.9 < way.score < 1.1


def test_keyframes_that_fit_half_as_well_as_such_of_the_map_are_no_other_way() -> None:
    def worse_elsewhere(closure: Closure, apart_m: float) -> float:
        here = se3.between(pair().paths[0].poses[closure.query.index], pair().paths[1].poses[closure.match.index])
        assert closure.prediction is not None
        moved = np.linalg.norm(here[:3, 3] - closure.prediction.T_query_match[:3, 3])
        return 0.45 if moved > 0.01 else 0.95

    assert found(worse_elsewhere) == []


def test_one_place_where_nothing_is_found_does_not_settle_it() -> None:
    def hidden_in_the_middle(closure: Closure, apart_m: float) -> float:
        return 0.1 if 15 <= closure.match.index < 25 else 0.9

    (way,) = found(hidden_in_the_middle)
    assert 6 <= len(way.agreeing) < len(way.tried)


def test_what_is_found_beyond_reach_does_not_agree() -> None:
    assert found(lambda closure, apart_m: 0.9, off=se3.from_yaw(0.0, np.array([5.0, 0.0, 0.0]))) == []
