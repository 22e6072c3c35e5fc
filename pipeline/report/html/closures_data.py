"""Closures for the page: their ends, evidence and reasons, and the scans of those that can be looked at."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wiclosure.pipeline.evaluation.body_axes import in_lidar_axes
from wiclosure.pipeline.evaluation.funnel import MEASURED
from wiclosure.pipeline.evaluation.metrics import StageCount
from wiclosure.pipeline.report.html.packing import packed
from wiclosure.pipeline.stages.run import RunResult
from wiclosure.types import Closure, KeyframeId, Stage

CLOUD_SCALE_M = 0.02
CLOUD_POINTS = 1_500
CLOUDS = 400
_FIGURES = re.compile(r"-?\d[\d.,^]*")
_STAGE_OF = {stage: name for name, stage in MEASURED.items()}  # where in the funnel a rejected closure was lost


def closure_rows(result: RunResult, origin: np.ndarray[Any, Any]) -> list[dict[str, Any]]:
    """One entry for each proposed closure."""
    graph, closures = result.solution.graph, result.solution.closures
    keyframes = {robot: front.keyframes for robot, front in result.fronts.items()}
    settings = result.config.evaluation
    truth = in_lidar_axes(result.merged, result.inputs.ground_truth, settings.ground_truth_gap_s)
    right, known = settings.judge(keyframes, truth).right(closures)
    component = {robot: n for n, group in enumerate(graph.components) for robot in group}
    rows = []
    for k, closure in enumerate(closures):
        ends = [graph.trajectories[key.robot].positions[key.index] - origin for key in (closure.query, closure.match)]
        together = component[closure.query.robot] == component[closure.match.robot]
        rows.append(
            {
                "query": [closure.query.robot, closure.query.index],
                "match": [closure.match.robot, closure.match.index],
                "decision": "accepted" if closure.rejected_at is None else "rejected",
                "rejected_at": None if closure.rejected_at is None else str(closure.rejected_at),
                "reason": closure.reason,
                "ends": _rounded(np.concatenate(ends)) if together else None,
                "T_query_match": _rounded(closure.best_T_query_match.ravel(), 5),
                "right": ("yes" if right[k] else "no") if known[k] else None,
                **_evidence(closure),
            }
        )
    return rows


def _evidence(closure: Closure) -> dict[str, Any]:
    found = closure.evidence
    figures: dict[str, float | None] = {
        "scan_context_distance": None if closure.scan_context is None else closure.scan_context.distance,
        "overlap_probability": closure.overlap_probability,
        "consistent_with": closure.consistent_with or None,
        "residual_m": None if closure.residual is None else closure.residual.translation_m,
        "residual_rad": None if closure.residual is None else closure.residual.rotation_rad,
    }
    if found is not None:
        figures |= {
            "prior_chi2": found.prediction_chi2,
            "inliers": found.inliers,
            "inlier_ratio": found.inlier_ratio,
            "agreement": found.agreement,
            "rms_m": found.rms_m,
        }
    return {name: _number(value) for name, value in figures.items()}


def _number(value: float | None) -> float | None:
    """JSON has no NaN; six digits are enough to look at."""
    return None if value is None or not np.isfinite(value) else float(f"{value:.6g}")


def _rounded(values: np.ndarray[Any, Any], digits: int = 3) -> list[float]:
    return [round(float(value), digits) for value in values]


def stages_with_reasons(funnel: Sequence[StageCount], closures: Sequence[Closure]) -> list[dict[str, Any]]:
    """The funnel, with the reasons for which closures were lost at each stage, the most frequent first."""
    lost: Mapping[str, dict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
    for row, closure in enumerate(closures):
        if closure.rejected_at in _STAGE_OF:
            lost[_STAGE_OF[closure.rejected_at]][_FIGURES.sub("#", closure.reason)].append(row)
    return [
        {
            **stage,
            "reasons": [
                {"text": closures[rows[0]].reason if len(rows) == 1 else kind, "count": len(rows), "rows": rows}
                for kind, rows in sorted(lost[stage["stage"]].items(), key=lambda item: -len(item[1]))
            ],
        }
        for stage in funnel
    ]


def scans_of_closures(result: RunResult) -> dict[str, Any]:
    """The scans of the first closures, thinned, accepted ones before those that came far before the rest."""
    ordered = sorted(result.solution.closures, key=lambda c: -int(c.rejected_at or Stage.ESTIMATE + 1))
    keys: dict[KeyframeId, None] = {}
    for closure in ordered:
        if len(keys) >= CLOUDS:
            break
        keys |= {closure.query: None, closure.match: None}
    return {
        "cloud_scale_m": CLOUD_SCALE_M,
        "clouds": {
            f"{key.robot}:{key.index}": _cloud(result.fronts[key.robot].clouds[key.index]) for key in list(keys)
        },
    }


def _cloud(points: np.ndarray[Any, Any]) -> dict[str, Any]:
    finite = points[np.isfinite(points).all(axis=1)]
    step = max(1, -(-len(finite) // CLOUD_POINTS))
    limit = np.iinfo(np.int16).max
    return packed(np.clip(np.round(finite[::step] / CLOUD_SCALE_M), -limit, limit).astype(np.int16))
