from __future__ import annotations

import numpy as np

from wiclosure.pipeline.mutual_check.radio_check import radio_checked
from wiclosure.types import Closure, FloatArray, IntArray, KeyframeId, Stage


class NothingBeyondKeyframeFive:
    """Objects to keyframes of a beyond the fifth."""

    def objections(
        self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray
    ) -> tuple[str, ...]:
        assert T_a_b.shape == (len(index_a), 4, 4)
        assert covariance.shape == (len(index_b), 6, 6)
        return tuple("too late" if index > 5 else "" for index in index_a)


def closure(query: str, match: str, index: int) -> Closure:
    measured = Closure.from_measurement(KeyframeId(query, index), KeyframeId(match, 2), np.eye(4), np.eye(6))
    return measured.accepted(Stage.REGISTRATION, "as it was")


def test_only_live_closures_of_the_robots_in_question_are_checked() -> None:
    refused = Closure(KeyframeId("alpha", 9), KeyframeId("beta", 2)).rejected(Stage.REGISTRATION, "too few points")
    closures = [
        closure("alpha", "beta", 3),
        closure("alpha", "beta", 8),
        refused,
        closure("alpha", "gamma", 9),
        closure("alpha", "alpha", 9),
    ]
    checked = radio_checked(closures, {("alpha", "beta"): NothingBeyondKeyframeFive()})
    rejected_at = [None, Stage.RADIO_CHECK, Stage.REGISTRATION, None, None]
    assert [c.rejected_at for c in checked] == rejected_at
    assert [c.reason for c in checked] == ["as it was", "too late", "too few points", "as it was", "as it was"]
    assert [c.survived(Stage.RADIO_CHECK) for c in checked] == [stage is None for stage in rejected_at]


def test_without_checks_every_live_closure_passes() -> None:
    (checked,) = radio_checked([closure("alpha", "beta", 8)], {})
    assert (checked.passed, checked.rejected_at, checked.reason) == (Stage.RADIO_CHECK, None, "as it was")
