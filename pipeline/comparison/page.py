"""The report of a comparison: what the filter was worth, all arms with medians, all runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wiclosure.display import significant
from wiclosure.pipeline.comparison.figures import FIGURES, ArmSummary, summaries
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.statistics import Spread
from wiclosure.pipeline.comparison.tables import against_rows, arm_rows
from wiclosure.pipeline.report.html.report import Arm, write_comparison_report


def write_comparison_page(folder: Path, comparison: Comparison) -> None:
    """Writes `report.html` over the arms' own reports; to look at, those of the first world.

    Raises:
        OutputError: it cannot be written.
    """
    first = comparison.outcomes[0].seed
    shown = [
        Arm(_arm_name(comparison, o.preset, o.filter), folder / o.folder)
        for o in comparison.outcomes
        if o.seed == first
    ]
    write_comparison_report(folder, summary_of(comparison), shown)


def summary_of(comparison: Comparison) -> dict[str, Any]:
    """What was compared, what the filter was worth, and the tables of all arms and runs."""
    arms = summaries(comparison)
    return {
        "of": _title(comparison),
        "verdict": comparison_verdict(comparison, arms),
        "tables": _tables(comparison, arms),
        "look_at": _arm_name(comparison, next(iter(comparison.plan.configs)), _compared_arm(comparison)),
    }


def _compared_arm(comparison: Comparison) -> str:
    """The filter that the verdict is of: `wiclosure`, or else the last."""
    return "wiclosure" if "wiclosure" in comparison.plan.filters else comparison.plan.filters[-1]


def _arm_name(comparison: Comparison, preset: str, name: str) -> str:
    return f"{preset} {name}" if len(comparison.plan.configs) > 1 else name


def comparison_verdict(comparison: Comparison, arms: Sequence[ArmSummary]) -> dict[str, Any]:
    """What a filter was worth: of the filter `wiclosure`, or else of the last, with the first preset."""
    presets, filters, name = list(comparison.plan.configs), comparison.plan.filters, _compared_arm(comparison)
    own = {(arm.preset, arm.filter): arm for arm in arms}
    sentences = [_worth(own[preset, name], own[preset, filters[0]], len(presets) > 1) for preset in presets]
    metrics = [o.metrics for o in comparison.arms[presets[0], name]]
    wrong = any(len(m["components"]) > 1 or m["closures"]["accepted_false"] for m in metrics)
    repeated = max(arm.runs for arm in arms) > 1
    notes = ["Figures are medians over the seeds."] if repeated else []
    return {
        "tone": "bad" if wrong else "good",
        "sentence": sentences[0],
        "next": _next(comparison, name),
        "notes": [*sentences[1:], *notes, *comparison.plan.remarks],
    }


def _worth(arm: ArmSummary, base: ArmSummary, several: bool) -> str:
    """Time, false closures and error of an arm against the base."""
    where = f", back end {arm.preset}" if several else ""
    if arm is base:
        figures = (f"{FIGURES[key].label}: {_text(found.median)}" for key, found in arm.figures.items())
        return f"Filter {arm.filter}{where}: {', '.join(figures)}."
    saving = arm.saving_percent
    parts = [
        _part(arm, base, "closing_s", "finding and using closures takes {}", " s", saving),
        _part(arm, base, "accepted_false", "{} false closures are accepted", ""),
        _part(arm, base, "ate_m", "the error is {}", " m"),
    ]
    known = [part for part in parts if part]
    said = known[0] if len(known) == 1 else f"{', '.join(known[:-1])}, and {known[-1]}"
    return f"With the filter {arm.filter} instead of {base.filter}{where}, {said}."


def _part(arm: ArmSummary, base: ArmSummary, key: str, form: str, unit: str, saving: Spread | None = None) -> str:
    found, without = arm.figures.get(key), base.figures.get(key)
    if found is None or without is None:
        return ""
    if not math.isfinite(found.median):
        return "the robots are not connected" + (", as before" if not math.isfinite(without.median) else "")
    own, before = (_text(spread.median) + unit for spread in (found, without))
    if own == before:
        return f"{form.format(own)} as before"
    share = "" if saving is None else f" ({abs(saving.median):.0f} % {'less' if saving.median >= 0 else 'more'})"
    instead = "where the robots were not connected" if not math.isfinite(without.median) else f"instead of {before}"
    return f"{form.format(own)} {instead}{share}"


def _text(value: float) -> str:
    """Two digits; whole numbers whole."""
    if not math.isfinite(value):
        return "unknown"
    if float(value).is_integer():
        return f"{value:,.0f}"
    return significant(value)


def _next(comparison: Comparison, name: str) -> list[str]:
    """Where to look when an arm went wrong."""
    wrong = [
        o
        for o in comparison.outcomes
        if o.filter == name and (len(o.metrics["components"]) > 1 or o.metrics["closures"]["accepted_false"])
    ]
    if not wrong:
        return []
    what = [
        f"not connected: {', '.join(' and '.join(c['robots']) for c in o.metrics['components'])}"
        if len(o.metrics["components"]) > 1
        else f"{o.metrics['closures']['accepted_false']} false closures"
        for o in wrong
    ]
    rest = [f"{len(wrong) - 3} more runs like these."] if len(wrong) > 3 else []
    return [f"See {o.folder / 'report.html'} ({w})." for o, w in list(zip(wrong, what, strict=True))[:3]] + rest


def _title(comparison: Comparison) -> str:
    plan = comparison.plan
    seeds = len({o.seed for o in comparison.outcomes})
    presets = f", presets {' and '.join(plan.configs)}" if len(plan.configs) > 1 else ""
    return f"comparison of {' and '.join(plan.filters)}{presets}{f', {seeds} seeds' if seeds > 1 else ''}"


def _tables(comparison: Comparison, arms: Sequence[ArmSummary]) -> list[dict[str, Any]]:
    """All arms, the same against the base seed by seed, and every run with a link to its report."""
    header, rows = arm_rows(arms)
    tables: list[dict[str, Any]] = []
    if len(comparison.outcomes) > len(arms):
        tables.append(
            {"caption": "All arms: median [smallest, largest] over the seeds", "header": header, "rows": rows}
        )
        header, rows = against_rows(arms)
        tables.append(
            {"caption": f"Against {comparison.plan.filters[0]}, seed by seed", "header": header, "rows": rows}
        )
    tables.append(
        {
            "caption": "All runs",
            "header": [
                "report",
                "seed",
                "preset",
                "filter",
                "ATE, m",
                "closures",
                "false",
                "closing time, s",
                "robots connected",
            ],
            "rows": [
                [
                    {"text": str(o.folder), "link": f"{o.folder.as_posix()}/report.html"},
                    str(o.seed),
                    o.preset,
                    o.filter,
                    None if (error_m := o.metrics["ate_m"]["team"]) is None else significant(error_m),
                    o.metrics["closures"]["accepted"],
                    o.metrics["closures"]["accepted_false"],
                    FIGURES["closing_s"].value(o.metrics),
                    len(o.metrics["components"][0]["robots"]),
                ]
                for o in comparison.outcomes
            ],
        }
    )
    return tables
