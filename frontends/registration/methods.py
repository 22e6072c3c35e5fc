"""The ways to measure the relative pose of two clouds, behind one interface."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any, Final, Protocol, TypeAlias

import numpy as np
import small_gicp

from wiclosure import se3
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration.prepared_cloud import CloudLevel, PreparedCloud
from wiclosure.frontends.registration.result import RegistrationResult, gicp_covariance
from wiclosure.types import FloatArray


class RegistrationMethod(Protocol):
    """Measures from several starts and says whether a result can be accepted."""

    def voxel_sizes_m(self, finest_m: float) -> tuple[float, ...]:
        """Resolutions at which clouds are needed, coarse to fine."""
        ...

    def measure(
        self, query: PreparedCloud, match: PreparedCloud, starts: FloatArray, settings: RegistrationSettings
    ) -> list[RegistrationResult]:
        """At least one optimum reached from the starts `(S, 4, 4)`."""
        ...

    def objection(self, result: RegistrationResult, settings: RegistrationSettings, *, predicted: bool) -> str:
        """Why the result is not accepted; empty if it is.

        Args:
            result: one of `measure`.
            settings: thresholds.
            predicted: a prediction exists.  Whether the result agrees with it is for the caller to decide, who rejects
                what contradicts; so a method may ask less of results that have a prediction to pass.
        """
        ...


_Pass: TypeAlias = tuple[int, float]
"""Level of the clouds, and how far correspondences reach, in voxels of the finest level."""


class CoarseToFineGicp:
    """Generalized ICP (Segal et al., RSS 2009) at three resolutions.

    Voxels of 4, 2 and 1 times the finest.  Correspondences reach 30 and 12 times the finest, and at the finest level
    twice, then 1.2 times: 15, 6, 1 and 0.6 m on a street.  A single fine pass fails for scans only 4-6 m apart, as the
    rings of the ground hold it back; wide correspondences in the last pass pull at what only one of the scans shows.
    All starts run at the coarse level, which is cheap; the best few distinct ones go on.
    """

    _VOXELS = (4.0, 2.0, 1.0)
    _COARSE: _Pass = (0, 30.0)
    _FINER: tuple[_Pass, ...] = ((1, 12.0), (2, 2.0), (2, 1.2))
    _ITERATIONS = 30
    _REFINED = 2

    def voxel_sizes_m(self, finest_m: float) -> tuple[float, ...]:
        """Three resolutions."""
        return tuple(factor * finest_m for factor in self._VOXELS)

    def measure(
        self, query: PreparedCloud, match: PreparedCloud, starts: FloatArray, settings: RegistrationSettings
    ) -> list[RegistrationResult]:
        """The best distinct optima, each refined to the finest level."""
        coarse = [self._align(self._COARSE, query, match, start, settings).T_target_source for start in starts]
        measured = []
        for start in self._best_distinct(query.levels[0], match.levels[0], coarse, query.voxel_m):
            T_query_match = start
            for finer in self._FINER:
                found = self._align(finer, query, match, T_query_match, settings)
                T_query_match = found.T_target_source
            measured.append(RegistrationResult.of(query, match, T_query_match, gicp_covariance(found, query)))
        return measured

    def objection(self, result: RegistrationResult, settings: RegistrationSettings, *, predicted: bool) -> str:
        """Too few matching points of structure, too small a share of it, or too many in free-space conflict."""
        needed = settings.min_inlier_ratio_with_prediction if predicted else settings.min_inlier_ratio
        if result.evidence.inliers < settings.min_inliers:
            return f"only {result.evidence.inliers} points of structure match, {settings.min_inliers} needed"
        if result.evidence.inlier_ratio < needed:
            found, wanted = _told_apart(result.evidence.inlier_ratio, needed)
            return f"only {found} of the structure matches, {wanted} needed"
        needed = settings.min_agreement_with_prediction if predicted else settings.min_agreement
        if result.evidence.agreement < needed:
            found, wanted = _told_apart(result.evidence.agreement, needed)
            return f"free-space conflict: agreement {found}, {wanted} needed"
        return ""

    def _align(
        self,
        level_and_reach: _Pass,
        query: PreparedCloud,
        match: PreparedCloud,
        start: FloatArray,
        settings: RegistrationSettings,
    ) -> Any:
        level, reach = level_and_reach
        return small_gicp.align(
            query.levels[level].cloud,
            match.levels[level].cloud,
            query.levels[level].tree,
            start,
            max_correspondence_distance=reach * query.voxel_m,
            num_threads=settings.num_threads,
            max_iterations=self._ITERATIONS,
        )

    def _best_distinct(
        self, query: CloudLevel, match: CloudLevel, poses: list[FloatArray], voxel_m: float
    ) -> list[FloatArray]:
        """The best few poses at the coarse level, one of each group of alike ones."""
        limit_m = self._VOXELS[0] * 2 * voxel_m
        scores = []
        for pose in poses:
            distance = query.distances(se3.transform(pose, match.points))
            # Each point counts by how near it lies, and not at all beyond the limit: far ones do not outvote near ones.
            scores.append(np.maximum(0.0, 1.0 - np.square(distance / limit_m)).mean())
        chosen: list[FloatArray] = []
        for index in np.argsort(scores)[::-1]:
            step = [se3.between(pose, poses[index]) for pose in chosen]
            if not any(np.linalg.norm(s[:3, 3]) < limit_m / 2 and se3.rotation_angle(s) < 0.15 for s in step):
                chosen.append(poses[index])
        return chosen[: self._REFINED]


def _told_apart(found: float, needed: float) -> tuple[str, str]:
    """Both with as many digits, two at least, as show that they differ."""
    digits = next((d for d in range(2, 7) if f"{found:.{d}f}" != f"{needed:.{d}f}"), 7)
    return f"{found:.{digits}f}", f"{needed:.{digits}f}"


class PointToPointIcp:
    """DiSCo-SLAM's registration: one point-to-point ICP from one start, accepted if the mean squared distance is small.

    Voxels of 0.4 m, correspondences up to 100 m, 100 iterations; the variance of every axis is the fitness.
    """

    _VOXEL_M = 0.4
    _CORRESPONDENCE_M = 100.0
    _ITERATIONS = 100

    def voxel_sizes_m(self, finest_m: float) -> tuple[float, ...]:
        """DiSCo-SLAM's one resolution, whatever the surroundings."""
        return (self._VOXEL_M,)

    def measure(
        self, query: PreparedCloud, match: PreparedCloud, starts: FloatArray, settings: RegistrationSettings
    ) -> list[RegistrationResult]:
        """The optimum reached from the first start."""
        found = small_gicp.align(
            query.levels[0].cloud,
            match.levels[0].cloud,
            query.levels[0].tree,
            starts[0],
            registration_type="ICP",
            max_correspondence_distance=self._CORRESPONDENCE_M,
            num_threads=settings.num_threads,
            max_iterations=self._ITERATIONS,
        )
        gaps_m = query.levels[0].distances(se3.transform(found.T_target_source, match.levels[0].points))
        fitness_m2 = max(float(np.square(gaps_m).mean()), 1e-6)
        return [RegistrationResult.of(query, match, found.T_target_source, fitness_m2 * np.eye(6))]

    def objection(self, result: RegistrationResult, settings: RegistrationSettings, *, predicted: bool) -> str:
        """Mean squared distance too large."""
        fitness_m2 = float(result.covariance[0, 0])
        if fitness_m2 > settings.max_fitness_m2:
            return f"mean squared distance {fitness_m2:.1f} m^2, at most {settings.max_fitness_m2:g} allowed"
        return ""


METHODS: Final = MappingProxyType[str, RegistrationMethod](
    {"gicp": CoarseToFineGicp(), "point-to-point": PointToPointIcp()}
)
