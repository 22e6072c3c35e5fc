"""The summary of a filter run as plain JSON values."""

from __future__ import annotations

from typing import Any

import numpy as np

from wiclosure.memory import peak_rss_mb
from wiclosure.types import AlignmentFit, AlignmentHypothesis, Calibration, FilterResult, FloatArray, FrameAlignment


def filter_summary(result: FilterResult) -> dict[str, Any]:
    """What `wiclosure filter --summary` writes.

    `T_a_b` are 16 numbers, row by row: odometry frame of b in that of a.  Matrices are null where nothing aligns.
    """
    return {
        "filter": result.filter_name,
        "pairs_total": result.pairs_total,
        "pairs_kept": result.pairs_kept,
        "seconds": result.seconds,
        "peak_rss_mb": peak_rss_mb(),
        "alignments": [_alignment(a) for a in result.alignments],
        "diagnosis": list(result.diagnosis),
    }


def _alignment(alignment: FrameAlignment) -> dict[str, Any]:
    best = alignment.best
    return {
        "robot_a": alignment.robot_a,
        "robot_b": alignment.robot_b,
        "T_a_b": None if best is None else _numbers(best.T_a_b),
        "covariance": None if alignment.covariance is None else _numbers(alignment.covariance),
        "ambiguous": alignment.ambiguous,
        "reason": alignment.reason,
        "heading_knowledge": alignment.heading_knowledge,
        "log_likelihood": None if best is None else best.log_likelihood,
        "paths_kept": [] if best is None else [list(map(int, kept)) for kept in best.paths_kept],
        "runner_up": None if alignment.best_alternative is None else _hypothesis(alignment.best_alternative),
        "rivals": [_hypothesis(alternative) for alternative in alignment.likely_alternatives],
        "fit": None if alignment.fit is None else _fit(alignment.fit),
        "suspected_fault": alignment.suspected_fault,
        "calibration": [_calibration(one) for one in alignment.calibration],
        "strain_probability": alignment.strain_probability,
        "corrections": list(alignment.corrections),
        "slip": [stamp_ns / 1e9 for stamp_ns in alignment.slip_ns or ()],
        "slipped_robot": alignment.slipped_robot or None,
    }


def _fit(fit: AlignmentFit) -> dict[str, Any]:
    """Counts in all, and by time: each list has one entry for each stretch, which begins at `starts` (s)."""
    counts = {name: getattr(fit, name) for name in ("bearings", "agreeing_bearings", "ranges", "agreeing_ranges")}
    return {
        **{name: int(count.sum()) for name, count in counts.items()},
        "probability": fit.probability,
        "by_time": {"starts": [int(s) / 1e9 for s in fit.starts_ns]}
        | {name: [int(n) for n in count] for name, count in counts.items()},
    }


def _calibration(one: Calibration) -> dict[str, Any]:
    return {
        "name": one.name,
        "unit": one.unit,
        "value": one.value,
        "sigma": one.sigma,
        "prior_sigma": one.prior_sigma,
    }


def _hypothesis(hypothesis: AlignmentHypothesis) -> dict[str, Any]:
    return {
        "T_a_b": _numbers(hypothesis.T_a_b),
        "log_likelihood": hypothesis.log_likelihood,
        "paths_kept": [list(map(int, kept)) for kept in hypothesis.paths_kept],
        "blunder": hypothesis.blunder,
    }


def _numbers(matrix: FloatArray) -> list[float]:
    return [float(value) for value in np.ravel(matrix)]
