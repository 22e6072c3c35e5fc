"""Figures of runs, and of arms over all their seeds."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from wiclosure.pipeline.comparison.figures import (
    FIGURES,
    closing_seconds,
    filter_share_percent,
    saving_percent,
    summaries,
)
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.tables import comparison_markdown

SECONDS = {"odometry": 100.0, "filter": 1.0, "matching": 2.0, "verification": 3.0, "optimisation": 4.0, "total": 125.0}


def test_closing_time_is_search_verification_and_optimisation() -> None:
    assert closing_seconds(SECONDS) == 10.0
    run, base = {"seconds": SECONDS}, {"seconds": SECONDS | {"verification": 33.0}}
    assert saving_percent(run, base) == pytest.approx(75.0)
    assert saving_percent(base, base) == 0.0
    assert filter_share_percent(run) == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("key", "changes", "value"),
    [
        ("ate_m", {}, 0.5),
        ("ate_m", {"ate_m": {"team": None}}, math.inf),
        ("ate_m", {"ate_m": {"team": None}, "ate_odometry_m": {"team": None}}, None),
        ("missed_percent", {}, 10.0),
        ("missed_percent", {"candidates": {"recall": None}}, None),
        ("false_rejected_percent", {}, 75.0),
        ("false_rejected_percent", {"candidates": {"false_rejected": None}}, None),
        ("closing_s", {}, 8.0),
        ("accepted_true", {}, 8),
        ("total_s", {}, 12.0),
    ],
)
def test_a_figure_is_known_unknown_or_that_of_a_failed_run(
    run_metrics: Callable[..., dict], key: str, changes: dict, value: float | None
) -> None:
    found = FIGURES[key].value(run_metrics(0.5, 2.0) | changes)
    assert found is value if value is None else found == pytest.approx(value)


def test_an_arm_is_compared_seed_by_seed_with_the_base_of_its_preset(repeated: Comparison) -> None:
    base, arm = summaries(repeated)[:2]
    assert (base.preset, base.filter, base.saving_percent, base.against_base) == ("strong", "none", None, {})
    assert (arm.preset, arm.filter, arm.runs) == ("strong", "wiclosure", 6)
    assert arm.saving_percent is not None
    assert arm.saving_percent.median == pytest.approx(50.0)
    assert (arm.against_base["ate_m"].better, arm.against_base["ate_m"].p) == (6, pytest.approx(2 / 64))
    assert arm.against_base["ate_m"].test == "sign test"  # a failure has no size
    assert "Wilcoxon" in arm.against_base["accepted_false"].test
    assert math.isinf(base.figures["ate_m"].largest)
    assert closing_seconds(arm.seconds) == pytest.approx(4.0)


def test_figures_without_ground_truth_are_left_out(
    run_metrics: Callable[..., dict], comparison_of: Callable[..., Comparison]
) -> None:
    nothing = dict.fromkeys(("precision", "recall", "false_rejected"))

    def unknown(name: str, seed: int) -> dict:
        own = run_metrics(None, 1.0)
        own |= {"ate_odometry_m": {"team": None}, "candidates": nothing | {"pruned": 0.5}}
        return own | {"closures": {"accepted_true": None, "accepted_false": None}}

    arm = summaries(comparison_of(unknown, seeds=1))[1]
    assert {"ate_m", "accepted_true", "missed_percent"}.isdisjoint(arm.figures)
    assert {"closing_s", "filter_share_percent"} <= set(arm.figures)
    assert "not connected" not in comparison_markdown(comparison_of(unknown, seeds=1))
