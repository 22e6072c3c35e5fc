from __future__ import annotations

import numpy as np

from wiclosure.pipeline.stages.run_result import nothing_left, nothing_to_merge, own_loops
from wiclosure.types import CandidatePairs, Closure, FilterResult, KeyframeId, Measured, Stage

MEASURED = Measured(np.eye(4), np.eye(6))


def closure(robot: str, other: str, *, reason: str = "") -> Closure:
    proposed = Closure(KeyframeId(robot, 0), KeyframeId(other, 9), passed=Stage.REGISTRATION, measured=MEASURED)
    return proposed.rejected(Stage.ESTIMATE, reason) if reason else proposed.accepted(Stage.ESTIMATE)


def test_loops_of_each_robot_are_counted() -> None:
    closures = [closure("a", "a"), closure("a", "a", reason="false"), closure("a", "b")]
    assert own_loops(closures) == ("a: of 2 proposed loops within its own path 2 were registered and 1 accepted",)


def test_one_robot_without_loops_has_nothing_to_merge() -> None:
    alone, both = {"a": None}, {"a": None, "b": None}
    assert "nothing to merge" in nothing_to_merge(alone, ())[0]  # type: ignore[arg-type]
    assert not nothing_to_merge(both, ())  # type: ignore[arg-type]
    assert not nothing_to_merge(alone, [closure("a", "a")])  # type: ignore[arg-type]


def test_the_usual_reason_stands_for_all_that_differ_in_figures() -> None:
    pairs = CandidatePairs.without_prediction("a", "b", *np.divmod(np.arange(4), 2))
    filtered = FilterResult("none", (pairs,), 9)
    lost = [closure("a", "b", reason=f"{n} sigma off") for n in (7, 8)] + [closure("a", "b", reason="one place")]
    (said,) = nothing_left(filtered, (), lost)
    assert said.startswith("no closure was accepted: of 9 pairs the filter kept 4")
    assert said.endswith("; for example: 7 sigma off")
    assert not nothing_left(filtered, (), [*lost, closure("a", "b")])
