from __future__ import annotations

from pathlib import Path

from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.plan import Plan
from wiclosure.pipeline.config import Config


def test_outcomes_are_sorted_by_arm_whatever_order_they_came_in() -> None:
    plan = Plan({"strong": Config(), "loose": Config()}, ("none", "wiclosure"), ())
    came = [(1, "loose", "wiclosure"), (0, "strong", "none"), (0, "loose", "wiclosure"), (1, "strong", "none")]
    compared = Comparison(plan, tuple(Outcome(seed, p, f, Path(), {}) for seed, p, f in came))
    arms = compared.arms
    assert list(arms) == [("strong", "none"), ("strong", "wiclosure"), ("loose", "none"), ("loose", "wiclosure")]
    assert [outcome.seed for outcome in arms["strong", "none"]] == [0, 1]
    assert [outcome.seed for outcome in arms["loose", "wiclosure"]] == [1, 0]
    assert arms["strong", "wiclosure"] == ()
    assert compared.base("strong") == arms["strong", "none"]
    assert compared.base("loose") == ()
