"""Whether the arms of a comparison put the robots in the same places: what can be told without ground truth."""

from __future__ import annotations

import math

from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.evaluation.metrics import StartMetrics

NOT_CONNECTED = "not connected"


def has_truth(comparison: Comparison) -> bool:
    """Whether any run could be held against ground truth."""
    return any(o.metrics["ate_odometry_m"]["team"] is not None for o in comparison.outcomes)


def start_rows(comparison: Comparison) -> list[list[str]]:
    """Arm, robots, x y z, yaw, and how far that is from the first arm which connects these robots in the same world."""
    several = len(comparison.plan.configs) > 1
    pairs = sorted({pair for outcome in comparison.outcomes for pair in outcome.metrics["starts"]})
    rows: list[list[str]] = []
    for pair in pairs:
        for outcome in comparison.outcomes:
            name = f"{outcome.preset}: {outcome.filter}" if several else outcome.filter
            rows.append([name, pair, *_cells(outcome, pair, _first(comparison, outcome, pair))])
    return rows


def _first(comparison: Comparison, outcome: Outcome, pair: str) -> Outcome | None:
    same = (o for o in comparison.outcomes if o.seed == outcome.seed and pair in o.metrics["starts"])
    return next(same, None)


def _cells(outcome: Outcome, pair: str, first: Outcome | None) -> list[str]:
    start = outcome.metrics["starts"].get(pair)
    if start is None or first is None:
        return ["-", "-", "-", "-", NOT_CONNECTED]
    apart = "" if first is outcome else _apart(start, first.metrics["starts"][pair])
    return [f"{start['x_m']:.2f}", f"{start['y_m']:.2f}", f"{start['z_m']:.2f}", f"{start['yaw_deg']:.2f}", apart]


def _apart(one: StartMetrics, other: StartMetrics) -> str:
    distance_m = math.dist((one["x_m"], one["y_m"], one["z_m"]), (other["x_m"], other["y_m"], other["z_m"]))
    turn_deg = abs(math.remainder(one["yaw_deg"] - other["yaw_deg"], 360.0))
    return f"{distance_m:.2f} m, {turn_deg:.2f} deg"
