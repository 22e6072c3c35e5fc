"""Where registration starts where nothing predicts the pose: at turns of scan context's yaw, or by KISS-Matcher."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from wiclosure import se3
from wiclosure.errors import ConfigError
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration import initial_guesses
from wiclosure.frontends.registration.prepared_cloud import PreparedCloud
from wiclosure.types import FloatArray

GlobalStarts: TypeAlias = Callable[[PreparedCloud, PreparedCloud, float | None], FloatArray]
"""Takes both clouds and scan context's yaw, rad or None; gives starts `T_query_match (S, 4, 4)`."""

_FEWEST_INLIERS = 5
_FEWEST_FEATURES, _NEIGHBOURS, _REACH_VOXELS = 10, 5, 3.0


def global_starts(settings: RegistrationSettings) -> GlobalStarts:
    """What the settings name.

    Raises:
        ConfigError: KISS-Matcher is wanted and not installed.
    """

    def around_scan_context(query: PreparedCloud, match: PreparedCloud, yaw_rad: float | None) -> FloatArray:
        return initial_guesses.around_scan_context(yaw_rad, settings.yaw_hypotheses)

    if settings.global_start == "scan-context":
        return around_scan_context
    return _KissMatcher(otherwise=around_scan_context)


class _KissMatcher:
    """A start from features of both clouds (Lim et al., "KISS-Matcher", ICRA 2025), before the others.

    The others stay: a second pose that fits as well is what tells that the place is ambiguous.
    """

    def __init__(self, otherwise: GlobalStarts) -> None:
        try:
            import kiss_matcher
        except ImportError as error:
            raise ConfigError(
                "registration.global_start is kiss-matcher, which is not installed; pip install"
                " 'wiclosure[kiss-matcher]', or set it to scan-context"
            ) from error
        self._library = kiss_matcher
        self._otherwise = otherwise

    def __call__(self, query: PreparedCloud, match: PreparedCloud, yaw_rad: float | None) -> FloatArray:
        others = self._otherwise(query, match, yaw_rad)
        # The middle level: features of the finest take twice the time and are no better.
        level = len(query.levels) // 2
        voxel_m = query.voxel_m * 2.0 ** (len(query.levels) - 1 - level)
        if not all(_has_features(cloud.levels[level].points, voxel_m) for cloud in (query, match)):
            return others
        matcher = self._library.KISSMatcher(self._library.KISSMatcherConfig(voxel_m))
        found = matcher.estimate(match.levels[level].points, query.levels[level].points)
        if not found.valid or matcher.get_num_final_inliers() < _FEWEST_INLIERS:
            return others
        T_query_match = np.eye(4)
        T_query_match[:3, :3], T_query_match[:3, 3] = found.rotation, found.translation
        return np.concatenate([se3.exp(se3.log(T_query_match[None])), others])  # a rotation to the last digit


def _has_features(points: FloatArray, voxel_m: float) -> bool:
    """Whether enough of the points `(N, 3)` have neighbours to be described by; without, KISS-Matcher crashes."""
    from scipy.spatial import cKDTree

    if len(points) < _FEWEST_FEATURES:
        return False
    neighbours = cKDTree(points).query_ball_point(points, _REACH_VOXELS * voxel_m, return_length=True) - 1
    return bool(np.sum(neighbours >= _NEIGHBOURS) >= _FEWEST_FEATURES)
