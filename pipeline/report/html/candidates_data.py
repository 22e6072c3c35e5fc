"""Candidate pairs of two robots for the page: the matrix of keyframes, binned, and the same as a small table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wiclosure.pipeline.evaluation.errors import truth_at
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.pipeline.report.html.packing import Array, packed_bytes, packed_steps
from wiclosure.types import CandidatePairs, Closure, Stage, Trajectory, survivors

BINS = 200
PARTS = 10
MOST_MATRICES = 12


@dataclass(frozen=True, eq=False)
class Overlap:
    """What is known of which pairs truly overlap."""

    truth: Mapping[str, Trajectory]
    settings: EvaluationSettings


def candidate_matrices(
    pairs: Sequence[CandidatePairs],
    keyframes: Mapping[str, Trajectory],
    closures: Sequence[Closure] = (),
    overlap: Overlap | None = None,
) -> list[dict[str, Any]]:
    """One matrix for each pair of robots, those with most candidates first, at most `MOST_MATRICES`."""
    shown = sorted(pairs, key=len, reverse=True)[:MOST_MATRICES]
    return [_matrix(of, keyframes[of.robot_a], keyframes[of.robot_b], closures, overlap) for of in shown]


def _matrix(
    pairs: CandidatePairs, a: Trajectory, b: Trajectory, closures: Sequence[Closure], overlap: Overlap | None
) -> dict[str, Any]:
    near = None if overlap is None else _near(a, b, overlap)
    fine, coarse = (_binned(pairs, near, (len(a), len(b)), (min(n, len(a)), min(n, len(b)))) for n in (BINS, PARTS))
    return {
        "a": pairs.robot_a,
        "b": pairs.robot_b,
        "pairs_kept": len(pairs),
        "pairs_total": len(a) * len(b),
        "seconds": [float((t.stamps_ns[-1] - t.stamps_ns[0]) * 1e-9) for t in (a, b)],
        "metres": [float(t.distance[-1]) for t in (a, b)],
        "bins": list(fine["size"].shape),
        "kept": packed_bytes(_share(fine["kept"], fine["size"])),
        "overlap": None if near is None else packed_bytes(_share(fine["overlap"], fine["size"])),
        "radius_m": None if near is None or overlap is None else overlap.settings.overlap_radius_m,
        "parts": {name: counts.astype(int).tolist() for name, counts in coarse.items() if name != "size"},
        "closures": packed_steps(_marks(pairs, closures) / [len(a), len(b)], 1e-4),
    }


def _near(a: Trajectory, b: Trajectory, overlap: Overlap) -> tuple[Array, Array] | None:
    """Indices of the pairs within the radius by ground truth; None where it covers none.

    A tree finds them: maps can hold millions of pairs.
    """
    from scipy.spatial import cKDTree

    gap_s = overlap.settings.ground_truth_gap_s
    (poses_a, known_a), (poses_b, known_b) = (truth_at(overlap.truth.get(t.robot), t.stamps_ns, gap_s) for t in (a, b))
    rows_a, rows_b = np.flatnonzero(known_a), np.flatnonzero(known_b)
    if not len(rows_a) or not len(rows_b):
        return None
    found = cKDTree(poses_a[rows_a, :3, 3]).sparse_distance_matrix(
        cKDTree(poses_b[rows_b, :3, 3]), overlap.settings.overlap_radius_m, output_type="coo_matrix"
    )
    return rows_a[found.row], rows_b[found.col]


def _binned(
    pairs: CandidatePairs, near: tuple[Array, Array] | None, of: tuple[int, int], shape: tuple[int, int]
) -> dict[str, Array]:
    """How many pairs each bin has, how many of them are kept, and how many overlap."""
    row, column = (np.arange(n) * bins // n for n, bins in zip(of, shape, strict=True))

    def count(index_a: Array, index_b: Array) -> Array:
        cell = np.ravel_multi_index((row[index_a], column[index_b]), shape)
        return np.bincount(cell, minlength=shape[0] * shape[1]).reshape(shape)

    counts = {
        "size": np.outer(np.bincount(row, minlength=shape[0]), np.bincount(column, minlength=shape[1])),
        "kept": count(pairs.index_a, pairs.index_b),
    }
    return counts if near is None else counts | {"overlap": count(*near)}


def _share(count: Array, size: Array) -> Array:
    """Shares as bytes; what is there at all stays visible."""
    return np.asarray(np.ceil(255 * count / size), np.uint8)


def _marks(pairs: CandidatePairs, closures: Sequence[Closure]) -> Array:
    """Keyframes `(K, 2)` of the accepted closures of the two robots, in the middle of their cells."""
    ends = [
        {c.query.robot: c.query.index, c.match.robot: c.match.index}
        for c in survivors(closures, Stage.ESTIMATE)
        if {c.query.robot, c.match.robot} == {pairs.robot_a, pairs.robot_b}
    ]
    return np.array([[end[pairs.robot_a], end[pairs.robot_b]] for end in ends], float).reshape(-1, 2) + 0.5
