"""A run in one sentence, and what to do next if anything is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from wiclosure.pipeline.evaluation.metrics import Metrics


def verdict(metrics: Metrics) -> dict[str, Any]:
    """Tone (`good`, `warn` or `bad`), sentence and next steps."""
    components = metrics["components"]
    robots = sum(len(c["robots"]) for c in components)
    accepted = metrics["closures"]["accepted"]
    false = metrics["closures"]["accepted_false"]
    if robots == 1:
        sentence, tone = f"One robot: {accepted} loops were closed within its trajectory.", "good"
    elif len(components) == 1:
        sentence, tone = f"All {robots} robots lie in one map, joined by {accepted} closures.", "good"
    else:
        joined = "; ".join(" and ".join(c["robots"]) for c in components)
        sentence, tone = f"The robots are not all connected: {joined}.", "bad"
    error_m = metrics["ate_m"].get("team")
    if error_m is not None:
        sentence = f"{sentence[:-1]}; the error against ground truth is {error_m:.2g} m."
    if false:
        sentence, tone = f"{sentence[:-1]}; {false} of the accepted closures are false.", "bad"
    return {"tone": tone, "sentence": sentence, "next": list(metrics["diagnosis"][:6])}


def headline_numbers(metrics: Metrics) -> list[dict[str, Any]]:
    """The numbers that people look for first."""
    kept, total = metrics["pairs_kept"], metrics["pairs_total"]
    numbers: list[dict[str, Any]] = [
        {"label": "team ATE, m", "value": metrics["ate_m"].get("team"), "note": "one alignment for all robots"},
        {"label": "closures accepted", "value": metrics["closures"]["accepted"]},
        {
            "label": "pairs kept by the filter",
            "value": f"{100 * kept / total:.2g} %" if total else None,
            "note": f"{kept:,} of {total:,}, filter {metrics['filter']}",
        },
        {"label": "seconds in all", "value": metrics["seconds"].get("total")},
    ]
    return [number for number in numbers if number["value"] is not None]


def compared(arms: Sequence[tuple[str, Metrics]]) -> dict[str, Any]:
    """Arms side by side, and what the last differs from the first by."""
    header = ["figure", *(name for name, _ in arms)]
    figures = [_figures(metrics) for _, metrics in arms]
    if len(arms) == 2:
        header.append("difference")
    rows = []
    for label in figures[0]:
        values = [of[label] for of in figures]
        row: list[Any] = [label, *values]
        if len(arms) == 2:
            first, last = values
            row.append(None if first is None or last is None else last - first)
        rows.append(row)
    return {"header": header, "rows": rows, "note": "ATE: one rigid alignment for all robots of the team."}


def _figures(metrics: Metrics) -> dict[str, float | None]:
    seconds = metrics["seconds"]
    closing = sum(seconds.get(stage, 0.0) for stage in ("filter", "matching", "verification", "optimisation"))
    return {
        "team ATE, m": metrics["ate_m"].get("team"),
        "robots in the first map": len(metrics["components"][0]["robots"]),
        "pairs kept": metrics["pairs_kept"],
        "closures proposed": metrics["closures"]["proposed"],
        "closures accepted": metrics["closures"]["accepted"],
        "false closures accepted": metrics["closures"]["accepted_false"],
        "recall of the true pairs": metrics["candidates"]["recall"],
        "seconds for closures": closing,
        "megabytes between the robots": None
        if metrics["bytes_exchanged"] is None
        else metrics["bytes_exchanged"] / 1e6,
    }
