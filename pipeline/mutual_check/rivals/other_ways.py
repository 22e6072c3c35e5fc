"""All ways of putting two robots together that their scans allow beside the one of the merged map.

The floor plan of what one robot saw is laid over that of the other.  Where that fits in another way, keyframes that it
brings together are registered, and judged as the closures of the map are.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from wiclosure import se3
from wiclosure.frontends.registration.floor_plans import LookAlike, other_ways, standing_points
from wiclosure.frontends.registration.initial_guesses import REACH_VOXELS, REACH_YAW_RAD
from wiclosure.frontends.registration.registration import is_elsewhere
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.pair_check import Pair
from wiclosure.pipeline.mutual_check.rivals.sets import FEWEST
from wiclosure.pipeline.mutual_check.set_evidence import NEAR_M, PLACE_KEYFRAMES
from wiclosure.types import (
    Closure,
    Float32Array,
    FloatArray,
    IntArray,
    KeyframeId,
    Prediction,
    PredictionKind,
    Stage,
    Trajectory,
    measured_poses,
    survivors,
)

Register = Callable[[Sequence[Closure]], list[Closure]]
"""Registers proposed closures."""

_MOST_KEYFRAMES = 60  # of a robot that its map is made of, evenly along its path
_MOST_PAIRS = 12  # of keyframes that are registered for each
_LEAST_SCORE = 0.01  # of keyframes that do not fit where the map has them: any others fit better
_YAW_SIGMA_RAD, _LEVEL_SIGMA_RAD, _HEIGHT_SIGMA_M = 0.05, 0.03, 0.5


@dataclass(frozen=True, eq=False)
class OtherWay:
    """A way of putting two robots together that fits about as well as the map does.

    Args:
        T: by which it moves the second robot's keyframes from where the map has them.
        tried: closures of keyframes that it brings together, registered.
        agreeing: those of them that were found there.
        moved_m: how far it moves the middle of the second robot's path.
        score: how well they fit, beside keyframes that the map brings as near to each other; 1: as well.
    """

    T: FloatArray
    tried: Sequence[Closure]
    agreeing: Sequence[Closure]
    moved_m: float
    score: float


@dataclass(frozen=True, eq=False)
class MergedPair:
    """Two robots in one map.

    Args:
        pair: the robots.
        paths: their keyframes in its frame.
        alike: transforms of the second robot's map that lay it over the first one's.
        voxel_m: resolution of the maps.
        config: of the run.
    """

    pair: Pair
    paths: tuple[Trajectory, Trajectory]
    alike: Sequence[LookAlike]
    voxel_m: float
    config: Config

    @classmethod
    def of(
        cls,
        pair: Pair,
        merged: Mapping[str, Trajectory],
        clouds: Mapping[str, Sequence[Float32Array]],
        config: Config,
    ) -> MergedPair:
        """Of all robots: keyframes in one frame (`merged`), and the clouds of each, in the body's axes."""
        paths = merged[pair[0]], merged[pair[1]]
        voxel_m = max(voxel_size_m(clouds[robot][len(clouds[robot]) // 2]) for robot in pair)
        fixed, moved = (_standing(path, clouds[path.robot], voxel_m) for path in paths)
        return cls(pair, paths, other_ways(fixed, moved, voxel_m), voxel_m, config)

    def other_ways(self, register: Register) -> Iterator[OtherWay]:
        """Those that fit about as well as the map does; `register` registers keyframes that they bring together."""
        wide = len(self._near(np.eye(4)))
        for alike in self.alike:
            proposed = self._proposed(alike.T)
            if len(proposed) < FEWEST or 2 * len(self._near(alike.T)) < wide:
                continue
            if not any(self._passed(register([one])) for one in _nearest(proposed)):
                continue
            tried = register(proposed)
            agreeing = self._passed(tried)
            if 2 * len(agreeing) >= len(tried):
                score = self._beside_map(agreeing, register)
                if score >= self.config.registration.ambiguity:
                    yield OtherWay(alike.T, tried, agreeing, self._moved_m(alike.T), score)

    def _beside_map(self, found: Sequence[Closure], register: Register) -> float:
        """How well keyframes fit that another way brings together, beside some that the map brings as near: a ratio.

        Scans share the less the farther apart they were taken, and the two ways do not bring the same ones together: a
        wrong map may well have one path run along the other, where the right one has them cross.
        """
        near = self._as_near_in_map(found)
        if len(near) == 0:
            return float("inf")
        like = register(self._of_keyframes(near, np.eye(4)))
        ratios = [_score(own) / max(_score(other), _LEAST_SCORE) for own, other in zip(found, like, strict=True)]
        return float(np.median(ratios))

    def _as_near_in_map(self, found: Sequence[Closure]) -> IntArray:
        """`(N, 2)` keyframes that the map has as far apart as N closures have theirs, of about the same places.

        None where it has none within reach of each other.
        """
        first, second = (cKDTree(path.positions) for path in self.paths)
        near = first.sparse_distance_matrix(second, NEAR_M, output_type="ndarray")
        if len(near) == 0:
            return np.zeros((0, 2), np.int64)
        apart_m = np.linalg.norm(measured_poses(found)[0][:, :3, 3], axis=1)
        further = np.abs(near["j"] - np.array([c.match.index for c in found])[:, None]) / PLACE_KEYFRAMES
        rows = np.argmin(np.abs(near["v"] - apart_m[:, None]) + further, axis=1)
        return np.column_stack([near["i"][rows], near["j"][rows]])

    def _moved_m(self, T: FloatArray) -> float:
        """By how much the middle of the second robot's path is moved."""
        middle = self.paths[1].positions.mean(axis=0)
        return float(np.linalg.norm(se3.transform(T, middle) - middle))

    def _near(self, T: FloatArray) -> IntArray:
        """`(N, 2)` keyframes that lie within reach of each other, one pair for each keyframe of the second robot."""
        first, second = self.paths
        apart_m, row = cKDTree(first.positions).query(se3.transform(T, second.positions))
        near = np.flatnonzero(apart_m < NEAR_M)
        return np.column_stack([np.asarray(row)[near], near])

    def _proposed(self, T: FloatArray) -> list[Closure]:
        """Closures of keyframes that lie near each other, evenly along the path."""
        near = self._near(T)
        chosen = near[np.unique(np.linspace(0, len(near) - 1, min(_MOST_PAIRS, len(near))).round().astype(int))]
        return self._of_keyframes(chosen, T)

    def _of_keyframes(self, rows: IntArray, T: FloatArray) -> list[Closure]:
        """Closures of keyframes `(N, 2)`, with what is predicted of them."""
        sigmas = [_LEVEL_SIGMA_RAD] * 2 + [_YAW_SIGMA_RAD] + [REACH_VOXELS / 2 * self.voxel_m] * 2 + [_HEIGHT_SIGMA_M]
        first, second = self.paths
        predicted = se3.between(first.poses[rows[:, 0]], T @ second.poses[rows[:, 1]])
        return [
            Closure(
                KeyframeId(first.robot, i),
                KeyframeId(second.robot, j),
                prediction=Prediction(pose, np.diag(np.square(sigmas)), PredictionKind.POSE),
            )
            for (i, j), pose in zip(rows.tolist(), predicted, strict=True)
        ]

    def _passed(self, tried: Sequence[Closure]) -> list[Closure]:
        """Those that need no prediction to be accepted, and are where this way has them, not where the map does."""
        settings = self.config.registration
        return [
            closure
            for closure in survivors(tried, Stage.REGISTRATION)
            if (found := closure.evidence) is not None
            and found.inlier_ratio >= settings.min_inlier_ratio
            and found.agreement >= settings.min_agreement
            and self._is_as_predicted(closure)
            and self._is_elsewhere(closure)
        ]

    def _is_as_predicted(self, closure: Closure) -> bool:
        """To within registration's reach: of equal pillars it may well find the next."""
        if closure.measured is None or closure.prediction is None:
            return False
        off = se3.between(closure.prediction.T_query_match, closure.measured.T_query_match)
        near = float(np.linalg.norm(off[:3, 3])) < REACH_VOXELS * self.voxel_m
        return near and float(se3.rotation_angle(off)) < REACH_YAW_RAD

    def _is_elsewhere(self, closure: Closure) -> bool:
        first, second = self.paths
        as_merged = se3.between(first.poses[closure.query.index], second.poses[closure.match.index])
        return closure.measured is not None and is_elsewhere(closure.measured.T_query_match, as_merged, self.voxel_m)


def _standing(path: Trajectory, clouds: Sequence[Float32Array], voxel_m: float) -> FloatArray:
    rows = np.unique(np.linspace(0, len(path) - 1, _MOST_KEYFRAMES).round().astype(int))
    return standing_points([clouds[row] for row in rows.tolist()], path.poses[rows], voxel_m)


def _nearest(proposed: Sequence[Closure]) -> list[Closure]:
    """Of each third of the path the keyframes that lie nearest to each other: if any fit, these do."""
    apart_m = np.array([np.linalg.norm(c.prediction.T_query_match[:3, 3]) for c in proposed if c.prediction])
    return [proposed[int(rows[np.argmin(apart_m[rows])])] for rows in np.array_split(np.arange(len(proposed)), 3)]


def _score(closure: Closure) -> float:
    return 0.0 if closure.evidence is None else closure.evidence.score
