"""A comparison in tables: all runs as CSV, runs and figures over the seeds as JSON, the latter as Markdown too."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from wiclosure.pipeline.comparison.figures import (
    FIGURES,
    ArmSummary,
    closing_seconds,
    filter_share_percent,
    saving_percent,
    summaries,
)
from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.statistics import Paired, Spread
from wiclosure.pipeline.evaluation.metrics import Metrics
from wiclosure.pipeline.runtime.output import write_json

MISSING = "-"
FAILED = "not connected"

Cell = str | float | None
ARM_COLUMNS: dict[str, Callable[[Metrics, Metrics], Cell]] = {
    "ate_m": lambda m, _: m["ate_m"]["team"],
    "ate_horizontal_m": lambda m, _: m["ate_horizontal_m"]["team"],
    "ate_odometry_m": lambda m, _: m["ate_odometry_m"]["team"],
    "connected_robots": lambda m, _: len(m["components"][0]["robots"]),
    "precision": lambda m, _: m["candidates"]["precision"],
    "recall": lambda m, _: m["candidates"]["recall"],
    "false_rejected": lambda m, _: m["candidates"]["false_rejected"],
    "pruned": lambda m, _: m["candidates"]["pruned"],
    "recall_registrable": lambda m, _: m["candidates_registrable"]["recall"],
    "closing_seconds": lambda m, _: closing_seconds(m["seconds"]),
    "spent_closing_seconds": lambda m, _: closing_seconds(m["seconds_spent"]),
    "saving_percent": saving_percent,
    "filter_share_percent": lambda m, _: filter_share_percent(m),
    "bytes_exchanged": lambda m, _: m["bytes_exchanged"],
    "peak_rss_mb": lambda m, _: m["peak_rss_mb"],
}
"""Columns of `comparison.csv` of a run and the base arm's run, besides its name, the funnel and the stage times."""


def write_tables(folder: Path, comparison: Comparison) -> None:
    """Writes `comparison.csv`, `comparison.json` and `comparison.md`."""
    rows = [_row(comparison, outcome) for outcome in comparison.outcomes]
    with (folder / "comparison.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    write_json(folder / "comparison.json", comparison_json(comparison))
    (folder / "comparison.md").write_text(comparison_markdown(comparison), encoding="utf-8")


def comparison_json(comparison: Comparison) -> dict[str, Any]:
    """`remarks`, `base`, `arms` (figures over the seeds), `runs` (all metrics of each run)."""
    return {
        "base": comparison.plan.filters[0],
        "remarks": list(comparison.plan.remarks),
        "arms": [_plain(asdict(arm)) for arm in summaries(comparison)],
        "runs": [
            {"preset": o.preset, "filter": o.filter, "seed": o.seed, "folder": str(o.folder), "metrics": o.metrics}
            for o in comparison.outcomes
        ],
    }


def comparison_markdown(comparison: Comparison) -> str:
    """Arms with medians and spread, arms against the base, and seconds per stage."""
    arms = summaries(comparison)
    repeated = max(arm.runs for arm in arms) > 1
    parts = [
        f"# Comparison\n\nBase arm: {comparison.plan.filters[0]}. Median over the seeds, [smallest, largest].",
        *comparison.plan.remarks,
        markdown(*arm_rows(arms)),
        *(["## Against the base arm, seed by seed", markdown(*against_rows(arms))] if repeated else []),
        "## Seconds per stage, median: uncached (what the arm costs alone, from raw scans) / spent in this invocation",
        markdown(*_stages(arms)),
    ]
    return "\n\n".join(parts) + "\n"


def arm_rows(arms: Sequence[ArmSummary], keys: Sequence[str] = tuple(FIGURES)) -> tuple[list[str], list[list[str]]]:
    """Header and rows: median and spread of each of these figures, one row per arm."""
    header = ["arm", "runs", *(FIGURES[key].label for key in keys), "saving, %"]
    rows = []
    for arm in arms:
        figures = [spread_text(arm.figures.get(key), FIGURES[key].form) for key in keys]
        rows.append([_name(arm, arms), str(arm.runs), *figures, spread_text(arm.saving_percent, "{:.1f}".format)])
    return header, rows


# ---------------------------------------------------------------------------------------------------------------- rows
def _row(comparison: Comparison, outcome: Outcome) -> dict[str, Cell]:
    metrics = outcome.metrics
    base = next((o.metrics for o in comparison.base(outcome.preset) if o.seed == outcome.seed), None)
    row: dict[str, Cell] = {"preset": outcome.preset, "filter": outcome.filter, "seed": outcome.seed}
    row |= {key: None if base is None else value(metrics, base) for key, value in ARM_COLUMNS.items()}
    for stage in metrics["funnel"]:
        name = stage["stage"].lower().replace(" ", "_")
        row |= {name: stage["count"], f"{name}_true": stage["true"], f"{name}_false": stage["false"]}
    row |= {f"seconds_{stage}": value for stage, value in metrics["seconds"].items()}
    row |= {f"spent_{stage}": value for stage, value in metrics["seconds_spent"].items()}
    return row | {"folder": str(outcome.folder)}


def against_rows(arms: Sequence[ArmSummary]) -> tuple[list[str], list[list[str]]]:
    """Header and rows: how each arm differs from the base arm, seed by seed."""
    header = ["arm", "figure", "median difference", "better", "worse", "of seeds", "p", "test"]
    rows = [
        [_name(arm, arms), FIGURES[key].label, *_paired(found, FIGURES[key].form)]
        for arm in arms
        for key, found in arm.against_base.items()
    ]
    return header, rows


def _stages(arms: Sequence[ArmSummary]) -> tuple[list[str], list[list[str]]]:
    rows = [
        [_name(arm, arms), *(f"{value:.2f} / {arm.seconds_spent[stage]:.2f}" for stage, value in arm.seconds.items())]
        for arm in arms
    ]
    return ["arm", *arms[0].seconds], rows


def _name(arm: ArmSummary, arms: Sequence[ArmSummary]) -> str:
    return arm.filter if len({a.preset for a in arms}) == 1 else f"{arm.preset} {arm.filter}"


def spread_text(found: Spread | None, form: Callable[[float], str]) -> str:
    """Median, and smallest and largest where they differ."""
    if found is None:
        return MISSING
    if found.smallest == found.largest:
        return _number(found.median, form)
    return f"{_number(found.median, form)} [{_number(found.smallest, form)}, {_number(found.largest, form)}]"


def _paired(found: Paired, form: Callable[[float], str]) -> list[str]:
    difference = MISSING if found.median_difference is None else form(found.median_difference)
    p = MISSING if found.p is None else f"{found.p:.3g}"
    return [difference, str(found.better), str(found.worse), str(found.pairs), p, found.test]


def _number(value: float, form: Callable[[float], str]) -> str:
    return form(value) if math.isfinite(value) else FAILED


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with its first column to the left and the others to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _plain(content: Any) -> Any:
    """The same for JSON, which has no infinity: a figure of a failed run is null."""
    if isinstance(content, dict):
        return {key: _plain(value) for key, value in content.items()}
    return None if isinstance(content, float) and not math.isfinite(content) else content
