"""Registration of proposed closures: where exactly does the match lie, and is the claim true?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from wiclosure import se3
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration import initial_guesses
from wiclosure.frontends.registration.global_registration import global_starts
from wiclosure.frontends.registration.methods import METHODS
from wiclosure.frontends.registration.prepared_cloud import PreparedCloud, PreparedClouds
from wiclosure.frontends.registration.result import RegistrationResult
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.types import Closure, Float32Array, FloatArray, Prediction, Stage

_ELSEWHERE_VOXELS, _ELSEWHERE_RAD = 4.0, 0.2


class Registration:
    """Measures proposed closures by registering their clouds, and decides whether to accept the result.

    A closure goes through when enough of what stands on the ground agrees in both clouds, and, where its relative pose
    is predicted, when the measurement does not contradict that: in repetitive surroundings a wrong pose fits as well as
    the true one, and only the prediction can tell.
    """

    def __init__(self, settings: RegistrationSettings | None = None) -> None:
        self._settings = settings or RegistrationSettings()
        self._method = METHODS[self._settings.method]
        self._global_starts = global_starts(self._settings)
        self._clouds = PreparedClouds(self._settings.cached_clouds, self._settings.num_threads)

    def verify(self, closure: Closure, cloud_query: Float32Array, cloud_match: Float32Array) -> Closure:
        """The closure measured, and accepted or rejected at registration with evidence and a reason.

        Args:
            closure: as proposed.
            cloud_query: `(N, 3)` keyframe cloud in the query's body axes.
            cloud_match: `(M, 3)` keyframe cloud in the match's.
        """
        query, match = self._prepare(closure, cloud_query, cloud_match)
        standing = min(len(query.structure), len(match.structure))
        # Also a guard: small_gicp crashes on empty clouds.
        if standing < self._settings.min_inliers / 2:
            reason = f"only {standing} points of one cloud stand on the ground: nothing to hold on to"
            return closure.rejected(Stage.REGISTRATION, reason)
        prediction = closure.prediction and closure.prediction.widened(self._settings.prediction_scale)
        starts = self._starts(closure, prediction, query, match)
        results = self._method.measure(query, match, starts, self._settings)
        chi2 = [None if prediction is None else result.chi2(prediction) for result in results]
        contradicts = np.array([self._contradicts(distance) for distance in chi2])
        score = np.array([result.score for result in results])
        best = int(np.lexsort((score, ~contradicts))[-1])
        others = [result for result, against in zip(results, contradicts, strict=True) if not against]
        measured = closure.measured_as(results[best].measured(chi2[best]))
        objection = (
            self._method.objection(results[best], self._settings, predicted=prediction is not None)
            or self._contradiction(results[best], prediction)
            or self._ambiguity(results[best], others, query.voxel_m)
        )
        if objection:
            return measured.rejected(Stage.REGISTRATION, objection)
        return measured.accepted(Stage.REGISTRATION, _support(results[best], chi2[best]))

    @property
    def chi2_limit(self) -> float:
        """Squared Mahalanobis distance from the prediction beyond which a measurement contradicts it."""
        return float(stats.chi2.ppf(self._settings.prior_probability, df=6))

    def _contradicts(self, chi2: float | None) -> bool:
        return chi2 is not None and chi2 > self.chi2_limit

    def _prepare(
        self, closure: Closure, cloud_query: Float32Array, cloud_match: Float32Array
    ) -> tuple[PreparedCloud, PreparedCloud]:
        # Of unlike clouds the coarser rules: what is fine in one has no counterpart in the other.
        finest_m = self._settings.voxel_size_m or max(voxel_size_m(cloud_query), voxel_size_m(cloud_match)) / 2
        sizes = self._method.voxel_sizes_m(finest_m)
        return self._clouds.get(closure.query, cloud_query, sizes), self._clouds.get(closure.match, cloud_match, sizes)

    def _starts(
        self, closure: Closure, prediction: Prediction | None, query: PreparedCloud, match: PreparedCloud
    ) -> FloatArray:
        yaw_rad = None if closure.scan_context is None else closure.scan_context.yaw_rad
        if prediction is None:
            return self._global_starts(query, match, yaw_rad)
        return initial_guesses.around_prediction(prediction, yaw_rad, query.voxel_m)

    def _contradiction(self, result: RegistrationResult, prediction: Prediction | None) -> str:
        """How a result contradicts the prediction; empty if it does not, or nothing is predicted."""
        if prediction is None or not self._contradicts(chi2 := result.chi2(prediction)):
            return ""
        gap = se3.between(prediction.T_query_match, result.T_query_match)
        return (
            f"contradicts the prediction: {np.linalg.norm(gap[:3, 3]):.1f} m and"
            f" {np.degrees(se3.rotation_angle(gap)):.0f} degrees from it, chi-square {chi2:.0f} above"
            f" {self.chi2_limit:.1f}"
        )

    def _ambiguity(self, best: RegistrationResult, others: Sequence[RegistrationResult], voxel_m: float) -> str:
        """Which other pose fits nearly as well; empty if none: in repetitive places the better of two is chance."""
        for other in others:
            elsewhere = is_elsewhere(other.T_query_match, best.T_query_match, voxel_m)
            if elsewhere and other.score > self._settings.ambiguity * best.score:
                metres, radians = _apart(other.T_query_match, best.T_query_match)
                return (
                    f"ambiguous: a pose {metres:.1f} m and {np.degrees(radians):.0f} degrees away fits nearly as well,"
                    f" {other.evidence.inlier_ratio:.2f} of the structure with agreement {other.evidence.agreement:.2f}"
                )
        return ""


def _support(result: RegistrationResult, chi2: float | None) -> str:
    found = result.evidence
    prediction = "" if chi2 is None else f", chi-square {chi2:.1f} from the prediction"
    return f"{found.inlier_ratio:.2f} of the structure matches within {found.rms_m:.2f} m rms{prediction}"


def is_elsewhere(T: FloatArray, T_other: FloatArray, voxel_m: float) -> bool:
    """Whether two poses of one cloud differ by more than registration at this resolution does."""
    metres, radians = _apart(T, T_other)
    return metres > _ELSEWHERE_VOXELS * voxel_m or radians > _ELSEWHERE_RAD


def _apart(T: FloatArray, T_other: FloatArray) -> tuple[float, float]:
    """Metres and radians between two poses."""
    gap = se3.between(T, T_other)
    return float(np.linalg.norm(gap[:3, 3])), float(se3.rotation_angle(gap))
