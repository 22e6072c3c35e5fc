"""Candidates and closures against ground truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from wiclosure import se3
from wiclosure.pipeline.evaluation.errors import truth_at
from wiclosure.pipeline.evaluation.metrics import CandidateMetrics, ClosureMetrics
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.types import CandidatePairs, Closure, FloatArray, Stage, Trajectory, measured_poses, survivors


def candidate_metrics(
    pairs: Sequence[CandidatePairs],
    keyframes: Mapping[str, Trajectory],
    truth: Mapping[str, Trajectory],
    *,
    radius_m: float,
    gap_s: float,
) -> CandidateMetrics:
    """Precision, recall and share pruned of the kept pairs; a pair is true within `radius_m`.

    Only pairs of which both keyframes have ground truth count, except for the share pruned, which needs none and counts
    all.  True pairs are counted by a tree, without listing them.
    """
    places = _true_places(keyframes, truth, gap_s)
    total = true = kept = kept_true = 0
    for pair in pairs:
        (poses_a, covered_a), (poses_b, covered_b) = places[pair.robot_a], places[pair.robot_b]
        position_a, position_b = poses_a[:, :3, 3], poses_b[:, :3, 3]
        total += int(covered_a.sum()) * int(covered_b.sum())
        true += _pairs_within(position_a[covered_a], position_b[covered_b], radius_m)
        counted = covered_a[pair.index_a] & covered_b[pair.index_b]
        apart = position_a[pair.index_a[counted]] - position_b[pair.index_b[counted]]
        kept += len(apart)
        kept_true += int((np.einsum("ni,ni->n", apart, apart) <= radius_m**2).sum())
    everything = sum(len(keyframes[pair.robot_a]) * len(keyframes[pair.robot_b]) for pair in pairs)
    return {
        "radius_m": radius_m,
        "true": true if total else None,
        "false": total - true if total else None,
        "kept_true": kept_true if total else None,
        "kept_false": kept - kept_true if total else None,
        "precision": kept_true / kept if kept else None,
        "recall": kept_true / true if true else None,
        "false_rejected": 1 - (kept - kept_true) / (total - true) if total > true else None,
        "pruned": 1 - sum(map(len, pairs)) / everything if everything else None,
    }


def _pairs_within(position_a: FloatArray, position_b: FloatArray, radius_m: float) -> int:
    from scipy.spatial import cKDTree

    if not len(position_a) or not len(position_b):
        return 0
    return int(cKDTree(position_a).count_neighbors(cKDTree(position_b), radius_m))


def closure_metrics(closures: Sequence[Closure], truth_check: TruthCheck) -> ClosureMetrics:
    """How far the closures of a run came, and which of them are true.

    Args:
        closures: every proposed closure with its final decision.
        truth_check: tells true from false.
    """
    verified, accepted = (survivors(closures, stage) for stage in (Stage.RADIO_CHECK, Stage.ESTIMATE))
    verified_true, verified_false = truth_check.count(verified)
    accepted_true, accepted_false = truth_check.count(accepted)
    return {
        "proposed": len(closures),
        "verified": len(verified),
        "accepted": len(accepted),
        "verified_true": verified_true,
        "verified_false": verified_false,
        "accepted_true": accepted_true,
        "accepted_false": accepted_false,
    }


@dataclass(frozen=True, eq=False)
class TruthCheck:
    """Tells by ground truth which closures are true.

    Args:
        keyframes: the trajectories that closures refer to.
        truth: ground truth by robot, as far as there is any with orientations.
        error_m: metres within which a closure is true, if it is also
        error_deg: within these degrees.
        gap_s: how near ground truth must be in time.
    """

    keyframes: Mapping[str, Trajectory]
    truth: Mapping[str, Trajectory]
    error_m: float
    error_deg: float
    gap_s: float

    @classmethod
    def of(
        cls, settings: EvaluationSettings, keyframes: Mapping[str, Trajectory], truth: Mapping[str, Trajectory]
    ) -> Self:
        """With the limits of the settings."""
        limits = settings.closure_error_m, settings.closure_error_deg, settings.ground_truth_gap_s
        return cls(keyframes, truth, *limits)

    def right(self, closures: Sequence[Closure]) -> tuple[np.ndarray, np.ndarray]:
        """Which of the closures `(N,)` are true, and for which of them ground truth says so."""
        metres, degrees, covered = closure_errors(closures, self.keyframes, self.truth, self.gap_s)
        return (metres <= self.error_m) & (degrees <= self.error_deg) & covered, covered

    def count(self, closures: Sequence[Closure]) -> tuple[int, int] | tuple[None, None]:
        """How many are true and how many false; None where ground truth says nothing."""
        return _tally(*self.right(closures), known=bool(self.truth))

    def near(
        self, closures: Sequence[Closure], truth: Mapping[str, Trajectory], radius_m: float
    ) -> tuple[int, int] | tuple[None, None]:
        """How many join places within the radius of each other and how many do not, by `truth` without orientations."""
        query, match, covered = _true_ends(closures, self.keyframes, truth, self.gap_s)
        near = np.linalg.norm(query[:, :3, 3] - match[:, :3, 3], axis=1) <= radius_m
        return _tally(near & covered, covered, known=bool(truth))


def _tally(right: np.ndarray, covered: np.ndarray, *, known: bool) -> tuple[int, int] | tuple[None, None]:
    """How many are right and how many are not; None where ground truth says nothing of any, or there is none."""
    if not covered.any() and (len(covered) or not known):
        return None, None
    return int(right.sum()), int((covered & ~right).sum())


def closure_errors(
    closures: Sequence[Closure], keyframes: Mapping[str, Trajectory], truth: Mapping[str, Trajectory], gap_s: float
) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Errors `(N,)` in m and degrees of the closures' measured poses, and for which of them ground truth says so."""
    true_query, true_match, covered = _true_ends(closures, keyframes, truth, gap_s)
    measured, _ = measured_poses(closures)
    error = se3.between(measured, se3.between(true_query, true_match))
    return np.linalg.norm(error[:, :3, 3], axis=1), np.degrees(se3.rotation_angle(error)), covered


def _true_places(
    keyframes: Mapping[str, Trajectory], truth: Mapping[str, Trajectory], gap_s: float
) -> dict[str, tuple[FloatArray, np.ndarray]]:
    """`truth_at` the keyframes of each robot."""
    return {robot: truth_at(truth.get(robot), t.stamps_ns, gap_s) for robot, t in keyframes.items()}


def _true_ends(
    closures: Sequence[Closure], keyframes: Mapping[str, Trajectory], truth: Mapping[str, Trajectory], gap_s: float
) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """True poses `(N, 4, 4)` of the closures' query and match, and for which closures ground truth covers both."""
    places = _true_places(keyframes, truth, gap_s)
    ends = np.array([[places[k.robot][0][k.index] for k in (c.query, c.match)] for c in closures]).reshape(-1, 2, 4, 4)
    covered = np.array([all(places[k.robot][1][k.index] for k in (c.query, c.match)) for c in closures], bool)
    return ends[:, 0], ends[:, 1], covered
