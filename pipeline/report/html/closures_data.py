"""Closures for the page: their ends, evidence and reasons, and the scans of those that can be looked at."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import chain, zip_longest
from typing import Any

import numpy as np

from wiclosure.pipeline.evaluation.closures import TruthCheck
from wiclosure.pipeline.evaluation.funnel import MEASURED
from wiclosure.pipeline.evaluation.metrics import StageCount
from wiclosure.pipeline.report.html.packing import Array, along_curve, packed_steps
from wiclosure.pipeline.report.html.scene_data import Placement
from wiclosure.pipeline.stages.closures_csv import decision
from wiclosure.types import Closure, Float32Array, FloatArray, KeyframeId, Trajectory

CLOUD_STEP_M = 0.05
CLOUD_POINTS = 1_500
CLOUDS = 300
_FIGURES = re.compile(r"-?\d+(?:[.,]\d+)*(?:\^-?\d+)?")
_STAGE_OF = {stage: name for name, stage in MEASURED.items()}  # where in the funnel a rejected closure was lost


def closure_rows(
    closures: Sequence[Closure],
    keyframes: Mapping[str, Trajectory],
    placement: Placement,
    truth_check: TruthCheck | None = None,
) -> list[dict[str, Any]]:
    """One entry for each closure.

    Args:
        closures: with their final decision.
        keyframes: poses in the world of each component.
        placement: where robots are drawn.
        truth_check: tells by ground truth which are true.
    """
    true = _true(closures, truth_check)
    return [
        {
            "query": [closure.query.robot, closure.query.index],
            "match": [closure.match.robot, closure.match.index],
            "decision": decision(closure),
            "rejected_at": None if closure.rejected_at is None else str(closure.rejected_at),
            "reason": closure.reason,
            "ends": _ends(closure, keyframes, placement),
            "T_query_match": _rounded(closure.best_T_query_match[:3], 4),
            "true": true.get(row),
            **_evidence(closure),
        }
        for row, closure in enumerate(closures)
    ]


def _true(closures: Sequence[Closure], truth_check: TruthCheck | None) -> dict[int, bool]:
    """By row, of the measured closures that ground truth covers."""
    rows = [row for row, closure in enumerate(closures) if closure.measured is not None]
    if truth_check is None or not rows:
        return {}
    right, known = truth_check.right([closures[row] for row in rows])
    return {row: bool(right[n]) for n, row in enumerate(rows) if known[n]}


def _ends(closure: Closure, keyframes: Mapping[str, Trajectory], placement: Placement) -> list[float]:
    ends = [keyframes[k.robot].positions[k.index] + placement.offset[k.robot] for k in (closure.query, closure.match)]
    return _rounded(np.concatenate(ends), 2)


def _evidence(closure: Closure) -> dict[str, float | None]:
    """What speaks for and against a closure; figures that nothing tells are left out."""
    found = closure.evidence
    figures: dict[str, float | None] = {
        "scan_context_distance": None if closure.scan_context is None else closure.scan_context.distance,
        "overlap_probability": closure.overlap_probability,
        "consistent_with": closure.consistent_with or None,
        "residual_m": None if closure.residual is None else closure.residual.translation_m,
        "residual_deg": None if closure.residual is None else float(np.degrees(closure.residual.rotation_rad)),
    }
    if found is not None:
        figures |= {
            "prior_chi2": found.prediction_chi2,
            "inliers": found.inliers,
            "inlier_ratio": found.inlier_ratio,
            "agreement": found.agreement,
            "rms_m": found.rms_m,
        }
    return {name: float(f"{value:.4g}") for name, value in figures.items() if value is not None and np.isfinite(value)}


def _rounded(values: Array, digits: int) -> list[float]:
    return [round(float(value), digits) for value in values.ravel()]


def stages_with_reasons(funnel: Sequence[StageCount], closures: Sequence[Closure]) -> list[dict[str, Any]]:
    """The funnel, with the reasons for which closures were lost at each stage, the most frequent first."""
    lost: Mapping[str, dict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
    for row, closure in enumerate(closures):
        if closure.rejected_at in _STAGE_OF:
            lost[_STAGE_OF[closure.rejected_at]][reason_kind(closure.reason)].append(row)
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


def reason_kind(reason: str) -> str:
    """A reason without its figures, so that like ones can be counted."""
    return _FIGURES.sub("…", reason)


def scans_of_closures(closures: Sequence[Closure], clouds: Mapping[str, Sequence[Float32Array]]) -> dict[str, Any]:
    """Thinned scans by `robot:index`, of accepted and rejected closures in turn, those that came far first."""
    far_first = sorted(closures, key=lambda c: -int(c.rejected_at or 0))
    accepted = [c for c in closures if c.rejected_at is None]
    rejected = [c for c in far_first if c.rejected_at is not None]
    keys: dict[KeyframeId, None] = {}
    for closure in chain.from_iterable(zip_longest(accepted, rejected)):
        if len(keys) >= CLOUDS:
            break
        keys |= {} if closure is None else {closure.query: None, closure.match: None}
    return {f"{key.robot}:{key.index}": _cloud(clouds[key.robot][key.index]) for key in keys}


def _cloud(points: FloatArray | Float32Array) -> dict[str, Any]:
    finite = np.asarray(points[np.isfinite(points).all(axis=1)], float)
    thinned = finite[:: max(1, -(-len(finite) // CLOUD_POINTS))]
    return packed_steps(thinned[along_curve(thinned, CLOUD_STEP_M)], CLOUD_STEP_M)
