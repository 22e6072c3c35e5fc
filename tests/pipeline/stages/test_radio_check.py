from __future__ import annotations

import numpy as np

from wiclosure.pipeline.stages.radio_check import unless_filter_objects
from wiclosure.types import Closure, Decision, Evidence, FilterResult, FloatArray, IntArray, KeyframeId


class NothingBeyondKeyframeFive:
    """Objects to keyframes of a beyond the fifth."""

    def objections(
        self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray
    ) -> tuple[str, ...]:
        assert T_a_b.shape == (len(index_a), 4, 4)
        assert covariance.shape == (len(index_b), 6, 6)
        return tuple("too late" if index > 5 else "" for index in index_a)


def closure(query: str, match: str, index: int, decision: Decision = Decision.VERIFIED) -> Closure:
    return Closure(
        KeyframeId(query, index), KeyframeId(match, 2), np.eye(4), np.eye(6), Evidence(), decision, reason="as it was"
    )


def test_only_verified_closures_of_the_robots_in_question_are_checked() -> None:
    closures = [
        closure("alpha", "beta", 3),
        closure("alpha", "beta", 8),
        closure("alpha", "beta", 9, Decision.REJECTED),
        closure("alpha", "gamma", 9),
        closure("alpha", "alpha", 9),
    ]
    filtered = FilterResult("test", (), 0, checks={("alpha", "beta"): NothingBeyondKeyframeFive()})
    checked = unless_filter_objects(closures, filtered)
    assert [c.decision for c in checked] == [
        Decision.VERIFIED,
        Decision.REJECTED,
        Decision.REJECTED,
        Decision.VERIFIED,
        Decision.VERIFIED,
    ]
    assert [c.reason for c in checked] == ["as it was", "too late", "as it was", "as it was", "as it was"]
    assert unless_filter_objects(closures, FilterResult("test", (), 0)) == closures
