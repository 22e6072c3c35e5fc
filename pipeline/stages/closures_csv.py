"""`closures.csv`: every proposed closure, how far it came, and why no further."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.formats.stamps import seconds_text
from wiclosure.types import Closure, FloatArray, Stage, Trajectory

_KEYS = ("query_robot", "query_index", "query_stamp", "match_robot", "match_index", "match_stamp")
_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_MATCHING = ("scan_context_distance", "scan_context_yaw", "overlap_probability")
_REGISTRATION = ("prior_chi2", "inliers", "inlier_ratio", "agreement", "rms_m")
_BACK_END = ("consistent_with", "residual_m", "residual_rad")
CLOSURE_COLUMNS = (*_KEYS, "decision", "reason", *_POSE, *_MATCHING, *_REGISTRATION, *_BACK_END)


def write_closures(
    path: Path,
    closures: Sequence[Closure],
    keyframes: Mapping[str, Trajectory],
    clouds: Mapping[str, Trajectory] | None = None,
) -> None:
    """Writes one row per closure; empty fields are unknown.

    Args:
        path: the file.
        closures: in the order of the rows; the pose is measured, or of those that were not, what it was guessed from.
        keyframes: by robot, with the stamps to write; poses are written between the bodies at these stamps.
        clouds: the same keyframes at the instants that their clouds belong to; None where these are the stamps.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(CLOSURE_COLUMNS)
        for closure in closures:
            keys = [
                value
                for key in (closure.query, closure.match)
                for value in (key.robot, key.index, *seconds_text([int(keyframes[key.robot].stamps_ns[key.index])]))
            ]
            pose = [f"{value:.6f}" for value in _pose(_at_stamps(closure, keyframes, clouds or keyframes))]
            found = ["" if value is None or np.isnan(value) else f"{value:.6g}" for value in _found(closure)]
            writer.writerow([*keys, decision(closure), closure.reason, *pose, *found])


def decision(closure: Closure) -> str:
    """How far a closure came, in the one word that files have for it."""
    if closure.rejected_at is not None:
        return "rejected"
    if closure.survived(Stage.CONSISTENCY):
        return "accepted"
    return "verified" if closure.survived(Stage.REGISTRATION) else "proposed"


def _at_stamps(closure: Closure, keyframes: Mapping[str, Trajectory], clouds: Mapping[str, Trajectory]) -> FloatArray:
    """`T_query_match (4, 4)` between the bodies at the keyframes' stamps."""
    query, match = closure.query, closure.match
    T_query_cloud = se3.between(keyframes[query.robot].poses[query.index], clouds[query.robot].poses[query.index])
    T_cloud_match = se3.between(clouds[match.robot].poses[match.index], keyframes[match.robot].poses[match.index])
    return np.asarray(T_query_cloud @ closure.best_T_query_match @ T_cloud_match)


def _pose(T: FloatArray) -> list[float]:
    return [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()]


def _found(closure: Closure) -> list[float | None]:
    """What matching, registration and back end found, in the order of the columns."""
    looks, evidence, residual = closure.scan_context, closure.evidence, closure.residual
    return [
        *((looks.distance, looks.yaw_rad) if looks else (None, None)),
        closure.overlap_probability,
        *(
            (evidence.prediction_chi2, evidence.inliers, evidence.inlier_ratio, evidence.agreement, evidence.rms_m)
            if evidence
            else (None, 0, None, None, None)
        ),
        closure.consistent_with,
        *((residual.translation_m, residual.rotation_rad) if residual else (None, None)),
    ]
