from __future__ import annotations

from collections.abc import Callable

import pytest

from wiclosure.pipeline.comparison.figures import summaries
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.page import comparison_verdict, summary_of


def test_what_the_filter_was_worth_in_one_sentence(repeated: Comparison) -> None:
    found = comparison_verdict(repeated, summaries(repeated))
    assert found["sentence"] == (
        "With the filter wiclosure instead of none, back end strong, finding and using closures takes 4 s instead of"
        " 8 s (50 % less), 0 false closures are accepted instead of 3, and the error is 0.50 m instead of 12 m."
    )
    assert found["tone"] == "good"
    assert found["notes"][0].startswith("With the filter wiclosure instead of none, back end loose")
    assert "Figures are medians over the seeds." in found["notes"]


def test_runs_that_went_wrong_are_named(
    comparison_of: Callable[..., Comparison], run_metrics: Callable[..., dict]
) -> None:
    wrong = comparison_of(lambda name, seed: run_metrics(0.5, 1.0, false=2 if seed == 1 else 0), seeds=2)
    found = comparison_verdict(wrong, summaries(wrong))
    assert found["tone"] == "bad"
    assert found["next"][0] == "See seed-1/strong/wiclosure/report.html (2 false closures)."
    assert len(found["next"]) == 2
    assert "the error is 0.50 m as before" in found["sentence"]


@pytest.mark.parametrize(("base_m", "words"), [(None, "as before"), (3.0, "the robots are not connected")])
def test_an_arm_that_fails(
    comparison_of: Callable[..., Comparison], run_metrics: Callable[..., dict], base_m: float | None, words: str
) -> None:
    failed = comparison_of(lambda name, _: run_metrics(None if name == "wiclosure" else base_m, 1.0), seeds=1)
    assert words in comparison_verdict(failed, summaries(failed))["sentence"]


def test_all_arms_and_all_runs_with_links(repeated: Comparison) -> None:
    summary = summary_of(repeated)
    assert summary["of"] == "comparison of none and wiclosure, presets strong and loose, 6 seeds"
    assert summary["look_at"] == "strong wiclosure"
    arms, against, runs = summary["tables"]
    assert [row[0] for row in arms["rows"]] == ["strong none", "strong wiclosure", "loose none", "loose wiclosure"]
    assert against["rows"]
    assert len(runs["rows"]) == 24
    assert runs["rows"][0][0] == {"text": "seed-0/strong/none", "link": "seed-0/strong/none/report.html"}
