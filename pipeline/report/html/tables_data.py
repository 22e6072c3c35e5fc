"""The figures of `metrics.json` as tables: of one run, and of arms side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from wiclosure.display import significant
from wiclosure.pipeline.evaluation.metrics import CandidateMetrics, Metrics

_CLOSING = ("filter", "matching", "verification", "optimisation")
_ERROR = "error against ground truth (ATE)"
_UNIT = {
    _ERROR: "m",
    "time to find and use closures": "s",
    "time in all": "s",
    "sent between robots": "MB",
    "true pairs kept": "%",
}


def figure_tables(metrics: Metrics) -> list[dict[str, Any]]:
    """Tables with a caption, a header and rows; those without rows are left out."""
    tables = (
        _candidates(metrics["candidates"], metrics["candidates_registrable"]),
        _closures(metrics),
        _memory_and_traffic(metrics),
        _trajectory_errors(metrics),
        _between_robots(metrics),
        _relative_errors(metrics),
    )
    return [table for table in tables if table["rows"]]


def _candidates(overlap: CandidateMetrics, registrable: CandidateMetrics) -> dict[str, Any]:
    names = ("true", "false", "kept_true", "kept_false", "precision", "recall", "false_rejected", "pruned")
    return {
        "caption": "Candidate pairs against ground truth",
        "header": ["", f"within {overlap['radius_m']:g} m", f"within {registrable['radius_m']:g} m"],
        "rows": [[name.replace("_", ", "), _share(overlap.get(name)), _share(registrable.get(name))] for name in names],
    }


def _share(value: Any) -> Any:
    """Shares of all pairs have four decimals: two digits of 0.9996 would be those of 1."""
    return f"{value:.4f}" if isinstance(value, float) else value


def _closures(metrics: Metrics) -> dict[str, Any]:
    return {
        "caption": "Closures",
        "header": ["", "number"],
        "rows": [[name.replace("_", ", "), count] for name, count in metrics["closures"].items()],
    }


def _memory_and_traffic(metrics: Metrics) -> dict[str, Any]:
    sent = metrics["bytes_exchanged"]
    return {
        "caption": "Memory and radio traffic",
        "header": ["", "MB"],
        "rows": [
            *([["peak memory of the process", peak]] if (peak := metrics["peak_rss_mb"]) is not None else []),
            ["sent between robots", None if sent is None else sent / 1e6],
        ],
    }


def _trajectory_errors(metrics: Metrics) -> dict[str, Any]:
    horizontal, own, odometry = metrics["ate_horizontal_m"], metrics["ate_own_m"], metrics["ate_odometry_m"]
    return {
        "caption": "Absolute trajectory error, m: one alignment for all connected robots",
        "header": ["robot", "merged", "without heights", "each robot aligned on its own", "odometry alone"],
        "rows": [
            [robot, *map(_metres, (error, horizontal.get(robot), own.get(robot), odometry.get(robot)))]
            for robot, error in metrics["ate_m"].items()
        ],
    }


def _between_robots(metrics: Metrics) -> dict[str, Any]:
    return {
        "caption": "Between robots, against ground truth",
        "header": ["robots", "translation error, m", "rotation error, degrees", "radio ambiguous"],
        "rows": [
            [pair, _metres(of["translation_error_m"]), of["rotation_error_deg"], _yes(of["ambiguous"])]
            for pair, of in metrics["alignment"].items()
        ],
    }


def _relative_errors(metrics: Metrics) -> dict[str, Any]:
    return {
        "caption": "Relative pose error, root mean square",
        "header": [
            "robot",
            "step, m",
            "step, degrees",
            "over, m",
            "translation, m",
            "translation, %",
            "rotation, degrees",
        ],
        "rows": [
            [
                robot,
                *(of["step_m"], of["step_deg"], of["distance_m"]),
                *(of["translation_m"], of["translation_percent"], of["rotation_deg"]),
            ]
            for robot, of in metrics["rpe"].items()
        ],
    }


def _metres(value: float | None) -> str | None:
    return None if value is None else significant(value)


def _yes(value: bool | None) -> str | None:
    return None if value is None else ("yes" if value else "no")


# --------------------------------------------------------------------------------------------------- arms side by side
def arms_table(arms: Sequence[tuple[str, Metrics]]) -> dict[str, Any]:
    """A table: one column for each arm; below each value what it differs from the first arm's by."""
    figures = [_figures(metrics) for _, metrics in arms]
    rows = [
        [label, *_cells([of[label] for of in figures], _UNIT.get(label, ""), apart=label == _ERROR)]
        for label in figures[0]
    ]
    return {
        "caption": "Arms side by side",
        "header": ["", *(name for name, _ in arms)],
        "rows": rows,
        "note": f"Small figures: difference from {arms[0][0]}. ATE: one rigid alignment for all robots.",
    }


def _figures(metrics: Metrics) -> dict[str, float | None]:
    seconds, recall, sent = metrics["seconds"], metrics["candidates"]["recall"], metrics["bytes_exchanged"]
    return {
        _ERROR: metrics["ate_m"].get("team"),
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


def _cells(values: Sequence[float | None], unit: str, *, apart: bool = False) -> list[dict[str, str]]:
    """Text of each value, and its difference from the first.

    All have as many decimals; those that may be orders of magnitude `apart`, as errors are, have two digits each.
    """
    known = [value for value in values if value is not None]
    decimals = _decimals([min(known, key=abs)] if apart and known else known) - (1 if apart else 0)
    decimals = max(decimals, 0)
    space = f" {unit}" if unit else ""

    def cell(value: float | None) -> dict[str, str]:
        if value is None:
            return {"text": "-", "note": ""}
        text = significant(value) if apart else f"{value:,.{decimals}f}"
        return {"text": f"{text}{space}", "note": _difference(value, values[0], decimals, space)}

    first, *others = values
    return [cell(first) | {"note": ""}, *map(cell, others)]


def _difference(value: float, base: float | None, decimals: int, space: str) -> str:
    if base is None:
        return ""
    difference = round(value - base, decimals)
    if not difference:
        return "the same"
    percent = 0.0 if not base or space == " %" else round(100 * (value / base - 1))
    share = f" ({percent:+.0f} %)" if percent else ""
    return f"{difference:+,.{decimals}f}{space}{share}"


def _decimals(values: Sequence[float]) -> int:
    """Three digits of the largest value; whole numbers have none."""
    if all(float(value).is_integer() for value in values):
        return 0
    return max(0, 2 - math.floor(math.log10(max(abs(value) for value in values))))
