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
from wiclosure.frontends.registration.initial_guesses import REACH_VOXELS
from wiclosure.frontends.registration.registration import is_elsewhere
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.pair_check import Pair
from wiclosure.pipeline.mutual_check.rivals.sets import FEWEST
from wiclosure.pipeline.mutual_check.set_evidence import NEAR_M
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
    survivors,
)

Register = Callable[[Sequence[Closure]], list[Closure]]
"""Registers proposed closures."""

_MOST_KEYFRAMES = 60  # of a robot that its map is made of, evenly along its path
_MOST_PAIRS = 12  # of keyframes that are registered for each
_YAW_SIGMA_RAD, _LEVEL_SIGMA_RAD, _HEIGHT_SIGMA_M = 0.05, 0.03, 0.5


@dataclass(frozen=True, eq=False)
class OtherWay:
    """A way of putting two robots together that fits about as well as the map does.

    Args:
        T: by which it moves the second robot's keyframes from where the map has them.
        tried: closures of keyframes that it brings together, registered.
        agreeing: those of them that were found there.
        moved_m: how far it moves the middle of the second robot's path.
        score: median of what registration tells of `tried`, 0 to 1.
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
        as_merged: tuple[int, float] | None = None
        for alike in self.alike:
            proposed = self._proposed(alike.T)
            if len(proposed) < FEWEST or not self._passed(register([_nearest(proposed)])):
                continue
            tried = register(proposed)
            agreeing = self._passed(tried)
            if as_merged is None:
                near = self._near(np.eye(4))
                as_merged = len(near), _score(register(self._proposed(np.eye(4))))
            wide, score = as_merged
            enough = 2 * len(self._near(alike.T)) >= wide and 2 * len(agreeing) >= len(tried)
            if enough and (own := _score(tried)) >= self.config.registration.ambiguity * score:
                yield OtherWay(alike.T, tried, agreeing, self._moved_m(alike.T), own)

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
        """Closures of keyframes that lie near each other, evenly along the path, with what is predicted of them."""
        near = self._near(T)
        chosen = near[np.unique(np.linspace(0, len(near) - 1, min(_MOST_PAIRS, len(near))).round().astype(int))]
        sigmas = [_LEVEL_SIGMA_RAD] * 2 + [_YAW_SIGMA_RAD] + [REACH_VOXELS / 2 * self.voxel_m] * 2 + [_HEIGHT_SIGMA_M]
        first, second = self.paths
        predicted = se3.between(first.poses[chosen[:, 0]], T @ second.poses[chosen[:, 1]])
        return [
            Closure(
                KeyframeId(first.robot, i),
                KeyframeId(second.robot, j),
                prediction=Prediction(pose, np.diag(np.square(sigmas)), PredictionKind.POSE),
            )
            for (i, j), pose in zip(chosen.tolist(), predicted, strict=True)
        ]

    def _passed(self, tried: Sequence[Closure]) -> list[Closure]:
        """Those that need no prediction to be accepted, and are not as the map has them."""
        settings = self.config.registration
        return [
            closure
            for closure in survivors(tried, Stage.REGISTRATION)
            if (found := closure.evidence) is not None
            and found.inlier_ratio >= settings.min_inlier_ratio
            and found.agreement >= settings.min_agreement
            and self._is_elsewhere(closure)
        ]

    def _is_elsewhere(self, closure: Closure) -> bool:
        first, second = self.paths
        as_merged = se3.between(first.poses[closure.query.index], second.poses[closure.match.index])
        return closure.measured is not None and is_elsewhere(closure.measured.T_query_match, as_merged, self.voxel_m)


def _standing(path: Trajectory, clouds: Sequence[Float32Array], voxel_m: float) -> FloatArray:
    rows = np.unique(np.linspace(0, len(path) - 1, _MOST_KEYFRAMES).round().astype(int))
    return standing_points([clouds[row] for row in rows.tolist()], path.poses[rows], voxel_m)


def _nearest(proposed: Sequence[Closure]) -> Closure:
    """Of the keyframes that lie nearest to each other: if any fit, these do."""
    return min(proposed, key=lambda c: float(np.linalg.norm(c.prediction.T_query_match[:3, 3])) if c.prediction else 0)


def _score(tried: Sequence[Closure]) -> float:
    """How well keyframes fit that are brought together: median over those with enough in them to tell."""
    scores = [closure.evidence.score for closure in tried if closure.evidence is not None]
    return float(np.median(scores)) if scores else 0.0
