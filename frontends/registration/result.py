"""How well two clouds agree under a pose, and how well the pose is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from wiclosure import se3
from wiclosure.frontends.registration.prepared_cloud import PreparedCloud
from wiclosure.types import FloatArray, Measured, Prediction, RegistrationEvidence, capped_covariance

_POINTS_SHARING_AN_ERROR = 30.0

# What all points of a cloud share, whatever their number: voxels, and above all the sway during a sweep, which constant
# motion does not undo.  Checked on simulated truth by benchmarks/front_end.py.
_FLOOR_VOXELS = 0.1  # 5 cm on a street
_FLOOR_M, _FLOOR_RAD = 0.02, 0.01

_LEAST_INFORMATION = 1e-3  # keeps directions that nothing constrains finite


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationResult:
    """One local optimum of a registration: its pose and covariance, and how well the clouds agree under it."""

    T_query_match: FloatArray
    covariance: FloatArray
    evidence: RegistrationEvidence

    @classmethod
    def of(cls, query: PreparedCloud, match: PreparedCloud, T_query_match: FloatArray, covariance: FloatArray) -> Self:
        """How well two clouds agree under a pose: points of structure count as matched within one voxel."""
        T_match_query = se3.inverse(T_query_match)
        seen = (
            _structure_seen(query, se3.transform(T_query_match, match.structure)),
            _structure_seen(match, se3.transform(T_match_query, query.structure)),
        )
        near = np.concatenate([found.gaps_m for found in seen])
        evidence = RegistrationEvidence(
            inliers=len(near),
            inlier_ratio=float(np.mean([found.share for found in seen])),
            agreement=min(found.agreement for found in seen),
            rms_m=float(np.sqrt(np.square(near).mean())) if len(near) else float("nan"),
        )
        return cls(T_query_match, covariance, evidence)

    @property
    def score(self) -> float:
        """What decides between poses of the same clouds."""
        return self.evidence.score

    def chi2(self, prediction: Prediction) -> float:
        """Squared Mahalanobis distance from a prediction."""
        error = se3.log(se3.between(prediction.T_query_match, self.T_query_match))
        return float(error @ np.linalg.solve(prediction.covariance + capped_covariance(self.covariance), error))

    def measured(self, prediction_chi2: float | None) -> Measured:
        """What a closure keeps of it."""
        return Measured(self.T_query_match, self.covariance, replace(self.evidence, prediction_chi2=prediction_chi2))


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """One cloud's structure in the other: distances of matched points, their share, and share of agreement."""

    gaps_m: FloatArray
    share: float
    agreement: float


def _structure_seen(by: PreparedCloud, points: FloatArray) -> _Seen:
    gaps_m = by.levels[-1].distances(points)
    matched = gaps_m < by.voxel_m
    count = int(matched.sum())
    refuted = int(by.free_space.conflicts(points[~matched]).sum())
    return _Seen(gaps_m[matched], count / max(len(points), 1), count / max(count + refuted, 1))


def gicp_covariance(result: Any, query: PreparedCloud) -> FloatArray:
    """Covariance `(6, 6)` of a GICP result.

    small_gicp's Hessian is of `T @ exp([rotation, translation])`, our convention (checked by finite differences in the
    tests).  Its inverse takes every point's error as independent and of the modelled size; both are optimistic.  It is
    scaled by the residual variance actually found, and by how many neighbouring points share one error, and a floor is
    added for what all points share: deskewing, calibration, discretisation.
    """
    residual_variance = max(1.0, 2.0 * result.error / max(result.num_inliers, 1))
    spread_m = max(1.0, float(np.sqrt(np.square(query.levels[-1].points).sum(axis=1).mean())))
    shared_m = _FLOOR_VOXELS * query.voxel_m
    floor = np.diag(np.repeat([(shared_m / spread_m) ** 2 + _FLOOR_RAD**2, shared_m**2 + _FLOOR_M**2], 3))
    information = result.H + _LEAST_INFORMATION * np.eye(6)
    return np.asarray(_POINTS_SHARING_AN_ERROR * residual_variance * np.linalg.inv(information) + floor)
