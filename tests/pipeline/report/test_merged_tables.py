from __future__ import annotations

import io

from rich.console import Console

from wiclosure.pipeline.report.merged_tables import MANY_ROWS, merged_tables

FOUND = {
    "robots": {"a": 40, "b [2]": 30},
    "components": [["a", "b [2]"]],
    "closures": {"read": 3, "accepted": 1, "rejected": []},
    "ambiguous": [],
    "sigma_scale": 1.0,
    "ignored": {"FIX": 2},
    "seconds": 0.25,
    "doubts": [],
    "diagnosis": ["a and b [2]: 1 of 3 closures agree"],
}
REJECTED = {
    "first": "a5",
    "second": "b30",
    "reason": "disagrees [with] the rest",
    "residual_m": 5.25,
    "residual_rad": 0.5,
}


def shown(found: dict, width: int = 140) -> str:
    out = io.StringIO()
    for table in merged_tables(found):
        Console(file=out, width=width, color_system=None).print(table)
    return out.getvalue()


def test_what_was_found_in_one_table() -> None:
    text = shown(FOUND)
    for part in (
        "a: 40 poses, b [2]: 30 poses",
        "1 of 3 accepted",
        "FIX: 2",
        "a and b [2]: 1 of 3 closures agree",
        "0.2",
    ):
        assert part in text
    assert "rejected closures" not in text
    assert "labels" not in text


def test_labels_of_a_robot_log_as_counts_and_shares_where_there_are_any() -> None:
    labels = {"true": 4, "false": 6, "accepted_true": 3, "accepted_false": 0, "precision": 1.0, "recall": 0.75}
    assert "3 of 4 true, 0 of 6 false, precision 100.0%, recall 75.0%" in shown(FOUND | {"labels": labels})
    unknown = labels | {"accepted_true": 0, "precision": None}
    assert "0 of 4 true, 0 of 6 false, recall 75.0%" in shown(FOUND | {"labels": unknown})


def test_rejected_closures_have_their_reason_and_how_far_off_they_are() -> None:
    unknown = REJECTED | {"second": "b99", "residual_m": None, "residual_rad": None}
    text = shown(FOUND | {"closures": {"read": 3, "accepted": 1, "rejected": [REJECTED, unknown]}})
    line = next(line for line in text.splitlines() if "a5 - b30" in line)
    assert "disagrees [with] the rest" in line
    assert "5.2 " in line
    assert "29 " in line  # degrees
    assert [word.strip() for word in next(line for line in text.splitlines() if "b99" in line).split("│")][3:5] == [
        "-",
        "-",
    ]


def test_many_rejected_closures_are_counted_not_listed() -> None:
    rejected = [REJECTED | {"second": f"b{n}"} for n in range(MANY_ROWS + 7)]
    text = shown(FOUND | {"closures": {"read": 60, "accepted": 13, "rejected": rejected}})
    assert text.count("a5 - b") == MANY_ROWS
    assert "and 7 more in closures.csv" in text
