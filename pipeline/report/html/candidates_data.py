"""Candidate pairs of two robots for the page: the matrix of keyframes, binned."""

from __future__ import annotations

from typing import Any

import numpy as np

from wiclosure.pipeline.evaluation.errors import truth_at
from wiclosure.pipeline.report.html.packing import packed
from wiclosure.pipeline.stages.run import RunResult
from wiclosure.types import CandidatePairs, FloatArray, Trajectory

BINS = 200
MATRICES = 12


def candidate_matrices(result: RunResult) -> list[dict[str, Any]]:
    """For the pairs of robots with most candidates."""
    pairs = sorted(result.solution.filtered.pairs, key=len, reverse=True)[:MATRICES]
    return [_matrix(result, of) for of in pairs]


def _matrix(result: RunResult, pairs: CandidatePairs) -> dict[str, Any]:
    a, b = (result.fronts[robot].keyframes for robot in (pairs.robot_a, pairs.robot_b))
    rows, columns = min(BINS, len(a)), min(BINS, len(b))
    bin_a, bin_b = np.arange(len(a)) * rows // len(a), np.arange(len(b)) * columns // len(b)
    size = np.outer(np.bincount(bin_a, minlength=rows), np.bincount(bin_b, minlength=columns))
    kept = np.zeros((rows, columns))
    np.add.at(kept, (bin_a[pairs.index_a], bin_b[pairs.index_b]), 1.0)
    radius_m, gap_s = result.config.evaluation.overlap_radius_m, result.config.evaluation.ground_truth_gap_s
    truth = [result.inputs.ground_truth.get(t.robot) for t in (a, b)]
    overlap = None if None in truth else _overlap(a, b, truth, radius_m, gap_s, (bin_a, bin_b), (rows, columns))
    accepted = [
        (c.query.index, c.match.index) if c.query.robot == pairs.robot_a else (c.match.index, c.query.index)
        for c in result.solution.graph.accepted
        if {c.query.robot, c.match.robot} == {pairs.robot_a, pairs.robot_b}
    ]
    marks = (np.array(accepted, float).reshape(-1, 2) + 0.5) / [len(a), len(b)] * 65535
    return {
        "a": pairs.robot_a,
        "b": pairs.robot_b,
        "pairs_kept": len(pairs),
        "pairs_total": len(a) * len(b),
        "bins": [rows, columns],
        "seconds": [float((t.stamps_ns[-1] - t.stamps_ns[0]) * 1e-9) for t in (a, b)],
        "metres": [float(t.distance[-1]) for t in (a, b)],
        "kept": packed(_share(kept, size)),
        "overlap": None if overlap is None else packed(_share(overlap, size)),
        "closures": packed(marks.astype(np.uint16).ravel()),
    }


def _share(count: FloatArray, size: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Shares as bytes; what is there at all stays visible."""
    return np.asarray(np.ceil(255 * count / size), np.uint8).ravel()


def _overlap(
    a: Trajectory,
    b: Trajectory,
    truth: list[Trajectory | None],
    radius_m: float,
    gap_s: float,
    bins: tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]],
    shape: tuple[int, int],
) -> FloatArray:
    """Pairs within the radius, counted by bin; a row of keyframes at a time, as maps can hold millions of pairs."""
    (poses_a, known_a), (poses_b, known_b) = (
        truth_at(of, t.stamps_ns, gap_s) for of, t in zip(truth, (a, b), strict=True)
    )
    counts = np.zeros(shape)
    for start in range(0, len(poses_a), 256):
        rows = slice(start, start + 256)
        apart = np.linalg.norm(poses_a[rows, None, :3, 3] - poses_b[None, :, :3, 3], axis=2)
        i, j = np.nonzero((apart <= radius_m) & known_a[rows, None] & known_b[None])
        np.add.at(counts, (bins[0][rows][i], bins[1][j]), 1.0)
    return counts
