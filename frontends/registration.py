"""Verification: is a proposed closure true, and where exactly does the match lie?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from wiclosure import se3
from wiclosure.frontends import initial_guesses
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.global_registration import global_starts
from wiclosure.frontends.prepared_cloud import PreparedCloud, PreparedClouds
from wiclosure.frontends.registration_methods import METHODS
from wiclosure.frontends.registration_result import Measurement
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.types import Closure, Decision, Float32Array, Prior, capped_covariance

_ELSEWHERE_VOXELS, _ELSEWHERE_RAD = 4.0, 0.2


class Registration:
    """Measures proposed closures by registering their clouds, and decides whether to believe the result.

    A closure goes through when enough of what stands on the ground agrees in both clouds, and, where the radio predicts
    the relative pose, when the measurement does not contradict it: in repetitive surroundings a wrong pose fits as well
    as the true one, and only the prediction can tell.
    """

    def __init__(self, settings: RegistrationSettings | None = None) -> None:
        self._settings = settings or RegistrationSettings()
        self._method = METHODS[self._settings.method]
        self._global_starts = global_starts(self._settings)
        self._clouds = PreparedClouds(self._settings.cached_clouds, self._settings.num_threads)

    def verify(
        self, closure: Closure, cloud_query: Float32Array, cloud_match: Float32Array, prior: Prior | None = None
    ) -> Closure:
        """The closure measured: verified or rejected, with evidence and a reason.

        Args:
            closure: as proposed.
            cloud_query: `(N, 3)` keyframe cloud in the query's body axes.
            cloud_match: `(M, 3)` keyframe cloud in the match's.
            prior: predicted `T_query_match (4, 4)` and its covariance `(6, 6)`, where the filter predicts.
        """
        if prior is not None:
            prior = prior[0], self._settings.prediction_scale**2 * prior[1]
        query, match = self._prepare(closure, cloud_query, cloud_match)
        standing = min(len(query.structure), len(match.structure))
        # Also a guard: small_gicp crashes on empty clouds.
        if standing < self._settings.min_inliers / 2:
            return _rejected(closure, f"only {standing} points of one cloud stand on the ground: nothing to hold on to")
        yaw = closure.evidence.scan_context_yaw
        if prior is None:
            starts = self._global_starts(query, match, yaw)
        else:
            starts = initial_guesses.around_prediction(*prior, yaw, query.voxel_m, located=closure.located)
        measured = self._method.measure(query, match, starts, self._settings)
        chi2 = np.array([_chi2(m, prior) for m in measured])
        # NaN without a prediction: comparing with it is false, so nothing contradicts.
        contradicts = chi2 > self.chi2_limit
        score = np.array([m.score for m in measured])
        best = int(np.lexsort((score, ~contradicts))[-1])
        judged = self._judge(closure, measured[best], prior, float(chi2[best]))
        rivals = [m for m, against in zip(measured, contradicts, strict=True) if not against]
        return self._unless_ambiguous(judged, measured[best], rivals, query.voxel_m)

    @property
    def chi2_limit(self) -> float:
        """Squared Mahalanobis distance from the prediction beyond which a measurement contradicts it."""
        return float(stats.chi2.ppf(self._settings.prior_probability, df=6))

    def _prepare(
        self, closure: Closure, cloud_query: Float32Array, cloud_match: Float32Array
    ) -> tuple[PreparedCloud, PreparedCloud]:
        # Of unlike clouds the coarser rules: what is fine in one has no counterpart in the other.
        finest_m = self._settings.voxel_size_m or max(voxel_size_m(cloud_query), voxel_size_m(cloud_match)) / 2
        sizes = self._method.voxel_sizes_m(finest_m)
        return self._clouds.get(closure.query, cloud_query, sizes), self._clouds.get(closure.match, cloud_match, sizes)

    def _judge(self, closure: Closure, measured: Measurement, prior: Prior | None, chi2: float) -> Closure:
        closure = replace(
            closure,
            T_query_match=measured.T_query_match,
            covariance=measured.covariance,
            evidence=replace(
                closure.evidence,
                inliers=measured.inliers,
                inlier_ratio=measured.inlier_ratio,
                agreement=measured.agreement,
                rms_m=measured.rms_m,
                prior_chi2=chi2,
            ),
        )
        objection = self._method.objection(measured, self._settings, predicted=prior is not None)
        if objection:
            return _rejected(closure, objection)
        if prior is not None and chi2 > self.chi2_limit:
            gap = se3.between(prior[0], measured.T_query_match)
            return _rejected(
                closure,
                f"contradicts the prediction: {np.linalg.norm(gap[:3, 3]):.1f} m and"
                f" {np.degrees(se3.rotation_angle(gap)):.0f} degrees from it, chi-square {chi2:.0f} above"
                f" {self.chi2_limit:.1f}",
            )
        agreement = "" if prior is None else f", chi-square {chi2:.1f} from the prediction"
        return replace(
            closure,
            decision=Decision.VERIFIED,
            reason=f"{measured.inlier_ratio:.2f} of the structure matches within {measured.rms_m:.2f} m rms{agreement}",
        )

    def _unless_ambiguous(
        self, judged: Closure, best: Measurement, rivals: Sequence[Measurement], voxel_m: float
    ) -> Closure:
        """Rejected where another pose fits nearly as well: in repetitive surroundings the better of two is chance."""
        for other in rivals:
            gap = se3.between(best.T_query_match, other.T_query_match)
            metres, radians = float(np.linalg.norm(gap[:3, 3])), float(se3.rotation_angle(gap))
            elsewhere = metres > _ELSEWHERE_VOXELS * voxel_m or radians > _ELSEWHERE_RAD
            if (
                judged.decision is Decision.VERIFIED
                and elsewhere
                and other.score > self._settings.ambiguity * best.score
            ):
                return _rejected(
                    judged,
                    f"ambiguous: a pose {metres:.1f} m and {np.degrees(radians):.0f} degrees away fits nearly as well,"
                    f" {other.inlier_ratio:.2f} of the structure with agreement {other.agreement:.2f}",
                )
        return judged


def _rejected(closure: Closure, reason: str) -> Closure:
    return replace(closure, decision=Decision.REJECTED, reason=reason)


def _chi2(measured: Measurement, prior: Prior | None) -> float:
    """Squared Mahalanobis distance of the measurement from the prediction; NaN where there is none."""
    if prior is None:
        return float("nan")
    T_predicted, covariance = prior
    error = se3.log(se3.between(T_predicted, measured.T_query_match))
    return float(error @ np.linalg.solve(covariance + capped_covariance(measured.covariance), error))
