from __future__ import annotations

import pytest

from wiclosure.pipeline.report.html.verdict import headline_numbers, run_verdict
from wiclosure.pipeline.stages.run_result import RunResult


def metrics_of(groups: list[list[str]], accepted: int, *, false: int | None = 0, ate_m: float | None = None) -> dict:
    return {
        "components": [{"robots": group, "ate_m": None} for group in groups],
        "closures": {"accepted": accepted, "accepted_false": false, "proposed": 20},
        "ate_m": {"team": ate_m},
        "diagnosis": ["said so"],
        "pairs_kept": 25,
        "pairs_total": 1000,
        "filter": "wiclosure",
        "seconds": {"total": 61.4},
    }


@pytest.mark.parametrize(
    ("metrics", "steps", "tone", "sentence"),
    [
        (metrics_of([["a"]], 0), [], "good", "One robot, with no loop closures within its path."),
        (metrics_of([["a", "b"]], 1), [], "good", "Both robots lie in one map, joined by 1 closure."),
        (
            metrics_of([["a", "b", "c"]], 9, ate_m=0.1234),
            ["vague"],
            "warn",
            "All 3 robots lie in one map, joined by 9 closures; the error against ground truth is 0.12 m.",
        ),
        (
            metrics_of([["a", "b"], ["c"]], 3),
            ["why"],
            "bad",
            "Not all robots are connected (a and b; c): 3 closures accepted.",
        ),
        (
            metrics_of([["a", "b"]], 3, false=1, ate_m=5.0),
            [],
            "bad",
            "Both robots lie in one map, joined by 3 closures; the error against ground truth is 5.0 m; 1 accepted"
            " closure is false.",
        ),
    ],
)
def test_a_run_in_one_sentence(metrics: dict, steps: list[str], tone: str, sentence: str) -> None:
    found = run_verdict(metrics, steps)
    assert (found["tone"], found["sentence"]) == (tone, sentence)
    assert (found["next"], found["notes"]) == (steps, ["said so"])


def test_numbers_have_units_and_unknown_ones_are_left_out() -> None:
    found = {number["label"]: number["value"] for number in headline_numbers(metrics_of([["a", "b"]], 3))}
    assert found == {"closures accepted": "3", "pairs of keyframes kept": "2.5 %", "time in all": "61 s"}


def test_a_run_with_a_lost_robot(lost_run: RunResult) -> None:
    found = run_verdict(lost_run.metrics, [])
    assert found["tone"] == "bad"
    assert found["sentence"].startswith("Not all robots are connected (alpha and beta; gamma): 8 closures accepted")
