"""The summary of a filter run as plain JSON values."""

from __future__ import annotations

from typing import Any

import numpy as np

from wiclosure.memory import peak_rss_mb
from wiclosure.types import AlignmentHypothesis, FilterResult, FloatArray, FrameAlignment


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
        "runner_up": None if alignment.runner_up is None else _hypothesis(alignment.runner_up),
        "rivals": [_hypothesis(rival) for rival in alignment.rivals],
    }


def _hypothesis(hypothesis: AlignmentHypothesis) -> dict[str, Any]:
    return {
        "T_a_b": _numbers(hypothesis.T_a_b),
        "log_likelihood": hypothesis.log_likelihood,
        "paths_kept": [list(map(int, kept)) for kept in hypothesis.paths_kept],
    }


def _numbers(matrix: FloatArray) -> list[float]:
    return [float(value) for value in np.ravel(matrix)]
