"""Closures as columns, one row each: the same words as in `closures.csv`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from wiclosure.closure import Closure


def closure_columns(closures: Sequence[Closure]) -> dict[str, list[Any]]:
    """Keyframes, decision with its reason, measured pose (m, rad), and evidence; NaN where it is not known.

    Columns: `query_robot`, `query_index`, `match_robot`, `match_index`, `accepted`, `rejected_at`, `reason`, `x_m`,
    `y_m`, `z_m`, `scan_context_distance`, `overlap_probability`, `inliers`, `agreement`, `residual_m`, `residual_rad`.
    """
    known = [(c.measured, c.evidence, c.residual, c.scan_context) for c in closures]
    place = [np.full(3, np.nan) if m is None else m.T_query_match[:3, 3] for m, _, _, _ in known]
    return {
        "query_robot": [c.query.robot for c in closures],
        "query_index": [c.query.index for c in closures],
        "match_robot": [c.match.robot for c in closures],
        "match_index": [c.match.index for c in closures],
        "accepted": [c.rejected_at is None for c in closures],
        "rejected_at": ["" if c.rejected_at is None else str(c.rejected_at) for c in closures],
        "reason": [c.reason for c in closures],
        **{f"{axis}_m": [float(p[k]) for p in place] for k, axis in enumerate("xyz")},
        "scan_context_distance": [np.nan if looks is None else looks.distance for _, _, _, looks in known],
        "overlap_probability": [np.nan if c.overlap_probability is None else c.overlap_probability for c in closures],
        "inliers": [0 if found is None else found.inliers for _, found, _, _ in known],
        "agreement": [np.nan if found is None else found.agreement for _, found, _, _ in known],
        "residual_m": [np.nan if off is None else off.translation_m for _, _, off, _ in known],
        "residual_rad": [np.nan if off is None else off.rotation_rad for _, _, off, _ in known],
    }
