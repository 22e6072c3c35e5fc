"""A comparison as CSV, JSON and Markdown."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import pytest

from wiclosure.pipeline.comparison.figures import FIGURES, summaries
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.statistics import Spread
from wiclosure.pipeline.comparison.tables import (
    arm_rows,
    comparison_json,
    comparison_markdown,
    markdown,
    spread_text,
    write_tables,
)
from wiclosure.pipeline.evaluation.funnel import STAGES


@pytest.mark.parametrize(
    ("spread", "text"),
    [
        (None, "-"),
        (Spread(1, 0.5, 0.5, 0.5), "0.50"),
        (Spread(3, 0.5, 0.25, 1.0), "0.50 [0.25, 1.00]"),
        (Spread(3, math.inf, 0.25, math.inf), "not connected [0.25, not connected]"),
    ],
)
def test_a_spread_as_text(spread: Spread | None, text: str) -> None:
    assert spread_text(spread, "{:.2f}".format) == text


def test_markdown_has_its_first_column_to_the_left() -> None:
    assert markdown(["arm", "m"], [["a", "1"]]) == "| arm | m |\n| --- | ---: |\n| a | 1 |"


def test_one_row_per_arm(repeated: Comparison) -> None:
    header, rows = arm_rows(summaries(repeated), ("ate_m",))
    assert header == ["arm", "runs", "ATE, m", "saving, %"]
    assert rows[:2] == [
        ["strong none", "6", "12 [10, not connected]", "-"],
        ["strong wiclosure", "6", "0.50", "50.0"],
    ]


def test_the_csv_has_one_row_for_each_run_and_every_column_is_documented(repeated: Comparison, tmp_path: Path) -> None:
    write_tables(tmp_path, repeated)
    with (tmp_path / "comparison.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 2 * 6
    assert [row["ate_m"] for row in rows[:2]] == ["", "10.0"]
    assert float(rows[6]["saving_percent"]) == pytest.approx(50.0)
    assert (rows[0]["pcm_true"], rows[0]["scan_context_false"]) == ("8", "1")
    documented = (Path(__file__).resolve().parents[3] / "docs" / "comparison.md").read_text(encoding="utf-8")
    stages = {f"seconds_{stage}" for stage in repeated.outcomes[0].metrics["seconds"]}
    counts = {f"{stage.lower().replace(' ', '_')}{of}" for stage in STAGES for of in ("", "_true", "_false")}
    spent = {stage.replace("seconds_", "spent_") for stage in stages}
    for column in set(rows[0]) - stages - counts - spent:
        assert f"`{column}`" in documented, column


def test_json_and_markdown_say_the_same_and_hold_no_infinity(repeated: Comparison) -> None:
    content = json.loads(json.dumps(comparison_json(repeated), allow_nan=False))
    assert set(content) == {"base", "remarks", "arms", "runs"}
    assert content["arms"][0]["figures"]["ate_m"]["largest"] is None
    assert content["runs"][0]["metrics"] == repeated.outcomes[0].metrics
    text = comparison_markdown(repeated)
    assert "not connected" in text
    assert "| strong wiclosure | 6 | 0.50 |" in text
    assert "6.00 / 5.00" in text  # total of the filter's arm, uncached and spent
    assert all(figure.label in text for figure in FIGURES.values())
