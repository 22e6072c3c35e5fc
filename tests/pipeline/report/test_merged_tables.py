from __future__ import annotations

import io

from rich.console import Console

from wiclosure.pipeline.report.merged_tables import merged_tables
from wiclosure.pipeline.stages.merged_folder import LabelScores, MergedSummary


def printed(**changes):
    row = {
        "first": "a1",
        "second": "b2",
        "decision": "rejected",
        "reason": "off",
        "residual_m": 2.5,
        "residual_rad": 0.1,
    }
    found = (
        MergedSummary(
            robots={"a": 3, "b": 4},
            components=[["a"], ["b"]],
            closures={"read": 60, "accepted": 10, "rejected": [row] * 50},
            ambiguous=[],
            sigma_scale=1.0,
            ignored={"FIX": 1, "[bold]": 2},
            seconds=0.2,
            diagnosis=["a sentence"],
        )
        | changes
    )
    console = Console(width=200, record=True, file=io.StringIO())
    for table in merged_tables(found):
        console.print(table)
    return console.export_text()


def test_what_was_found_and_what_was_rejected_is_told():
    text = printed()
    for part in ("a: 3 poses, b: 4 poses", "10 of 60 accepted", "a; b", "FIX: 1, [bold]: 2", "a sentence", "a1 - b2"):
        assert part in text
    assert "and 10 more in closures.csv" in text
    assert "5.7" in text  # degrees
    assert "labels" not in text


def test_labels_are_told_where_there_are_any():
    scores = LabelScores(true=12, false=8, accepted_true=9, accepted_false=1, precision=0.9, recall=0.75)
    assert "9 of 12 true, 1 of 8 false, precision 90.0%, recall 75.0%" in printed(labels=scores)
    none = LabelScores(true=0, false=8, accepted_true=0, accepted_false=0, precision=None, recall=None)
    assert "0 of 0 true, 0 of 8 false" in printed(labels=none)
