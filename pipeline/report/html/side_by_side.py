"""Arms of a comparison side by side, each with its difference from the first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from wiclosure.pipeline.evaluation.metrics import Metrics

_CLOSING = ("filter", "matching", "verification", "optimisation")
_UNIT = {
    "error against ground truth (ATE)": "m",
    "time to find and use closures": "s",
    "time in all": "s",
    "sent between robots": "MB",
    "true pairs kept": "%",
}


def side_by_side(arms: Sequence[tuple[str, Metrics]]) -> dict[str, Any]:
    """A table: one column for each arm; below each value what it differs from the first arm's by."""
    figures = [_figures(metrics) for _, metrics in arms]
    rows = [[label, *_cells([of[label] for of in figures], _UNIT.get(label, ""))] for label in figures[0]]
    return {
        "caption": "Arms side by side",
        "header": ["", *(name for name, _ in arms)],
        "rows": rows,
        "note": f"Small figures: difference from {arms[0][0]}. ATE: one rigid alignment for all robots.",
    }


def _figures(metrics: Metrics) -> dict[str, float | None]:
    seconds, recall, sent = metrics["seconds"], metrics["candidates"]["recall"], metrics["bytes_exchanged"]
    return {
        "error against ground truth (ATE)": metrics["ate_m"].get("team"),
        "robots in one map": len(metrics["components"][0]["robots"]),
        "pairs of keyframes kept": metrics["pairs_kept"],
        "true pairs kept": None if recall is None else 100 * recall,
        "closures proposed": metrics["closures"]["proposed"],
        "closures accepted": metrics["closures"]["accepted"],
        "false closures accepted": metrics["closures"]["accepted_false"],
        "time to find and use closures": sum(seconds.get(stage, 0.0) for stage in _CLOSING),
        "time in all": seconds.get("total"),
        "sent between robots": None if sent is None else sent / 1e6,
    }


def _cells(values: Sequence[float | None], unit: str) -> list[dict[str, str]]:
    """Text of each value, all with as many decimals, and the difference from the first."""
    decimals = _decimals([value for value in values if value is not None])
    space = f" {unit}" if unit else ""

    def cell(value: float | None) -> dict[str, str]:
        if value is None:
            return {"text": "-", "note": ""}
        return {"text": f"{value:,.{decimals}f}{space}", "note": _difference(value, values[0], decimals, space)}

    first, *others = values
    return [cell(first) | {"note": ""}, *map(cell, others)]


def _difference(value: float, base: float | None, decimals: int, space: str) -> str:
    if base is None:
        return ""
    difference = round(value - base, decimals)
    if not difference:
        return "the same"
    share = "" if not base or space == " %" else f" ({100 * (value / base - 1):+.0f} %)"
    return f"{difference:+,.{decimals}f}{space}{share}"


def _decimals(values: Sequence[float]) -> int:
    """Three digits of the largest value; whole numbers have none."""
    if all(float(value).is_integer() for value in values):
        return 0
    return max(0, 2 - math.floor(math.log10(max(abs(value) for value in values))))
