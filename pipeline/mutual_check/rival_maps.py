"""Merged maps of two robots that fit as well otherwise: closures of places that look alike agree, and may all be false.

A hall that looks the same turned by half a turn shows each scan twice.  No registration of a closure tells that, as
the other place lies far off, and where all closures that were found are of the same wrong half turn, none contradicts
them.  So the map of one robot is laid over that of the other in all ways.  Where another way fits, keyframes that it
brings together are registered, and judged as the accepted ones are.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import cKDTree

from wiclosure import se3
from wiclosure.frontends.registration.floor_plans import LookAlike, other_ways, standing_points
from wiclosure.frontends.registration.initial_guesses import REACH_VOXELS
from wiclosure.frontends.registration.registration import is_elsewhere
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.odds import in_words
from wiclosure.pipeline.mutual_check.pair_check import Pair
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.rival_sets import FEWEST, MAY_BE_WRONG, RivalSets, told_apart
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
    WirelessLog,
    survivors,
)

Register = Callable[[Sequence[Closure]], list[Closure]]
"""Registers proposed closures."""

_MOST_KEYFRAMES = 60  # of a robot that its map is made of, evenly along its path
_OVERDETERMINED = 20  # measurements: about as many as there are known errors to choose from
_MOST_PAIRS = 12  # of keyframes that are registered for each
_YAW_SIGMA_RAD, _LEVEL_SIGMA_RAD, _HEIGHT_SIGMA_M = 0.05, 0.03, 0.5


@dataclass(frozen=True, eq=False)
class RivalMap:
    """Another way in which two robots may lie to each other, that their scans allow, and their radio does not refute.

    Args:
        pair: the robots.
        moved_m: how far the middle of the second one's path would lie from where it is.
        turned_rad: by how much that robot would be turned.
        agreeing: registrations that agree with it, of `tried`.
        tried: keyframes that it brings together.
        radio: what the robots measured of each other tells of the two, as a clause; empty where nothing was measured.
    """

    pair: Pair
    moved_m: float
    turned_rad: float
    agreeing: int
    tried: int
    radio: str = ""

    @property
    def sentence(self) -> str:
        """For the user."""
        first, second = self.pair
        return (
            f"{first} and {second}: {MAY_BE_WRONG}: the scans fit as well if {second} is put {self.moved_m:.1f} m from"
            f" there and turned by {np.degrees(abs(self.turned_rad)):.0f} degrees ({self.agreeing} of {self.tried}"
            f" registrations agree), as where places look alike; {self.radio or 'nothing tells which is true'}"
        )


def rival_maps(
    merged: Mapping[str, Trajectory],
    closures: Sequence[Closure],
    clouds: Mapping[str, Sequence[Float32Array]],
    odometry: Mapping[str, Trajectory],
    wireless: WirelessLog,
    trusted: Collection[Pair],
    config: Config,
    register: Register,
) -> list[RivalMap]:
    """Of robots that accepted closures join, one at most for each two.

    Args:
        merged: keyframes of all robots, each in the frame of its map.
        closures: of the run.
        clouds: of all keyframes, `(N, 3)` in the body's axes, by robot.
        odometry: keyframes of all robots, each in a frame of its own.
        wireless: the whole log, as it was read.
        trusted: pairs whose radio is certain of an alignment that the map agrees with; they are not looked at where
            they measured so much that no known error makes the log fit a wrong alignment by chance.
        config: of the run.
        register: registers keyframes that are brought together.
    """
    found: list[RivalMap | None] = []
    measured = Counter(frozenset((m.receiver, m.transmitter)) for m in wireless.measurements)
    overdetermined = {pair for pair in map(frozenset, trusted) if measured[pair] >= _OVERDETERMINED}
    accepted: dict[Pair, list[Closure]] = {}
    for closure in survivors(closures, Stage.ESTIMATE):
        accepted.setdefault((closure.query.robot, closure.match.robot), []).append(closure)
    for pair in _joining({pair: len(of) for pair, of in accepted.items()}):
        if frozenset(pair) not in overdetermined:
            radio = PairRadio.of(pair, odometry, wireless, config.filter.alignment)
            of_pair = _Merged.of(pair, merged, clouds, config)
            found.append(_least_decided(list(of_pair.rivals(register)), accepted[pair], radio, config))
    return [one for one in found if one is not None]


def _joining(closures: Mapping[Pair, int]) -> list[Pair]:
    """Of pairs by how many closures they have, those that hold the map together: a tree, of the pairs with most.

    Others agree with these.  If places look alike, one of these is wrong as well.
    """
    pairs = [pair for pair in closures if pair[0] != pair[1]]
    if not pairs:
        return []
    number = {robot: n for n, robot in enumerate(dict.fromkeys(robot for pair in pairs for robot in pair))}
    rows, columns = np.array([[number[robot] for robot in pair] for pair in pairs]).T
    graph = coo_array(([1.0 / closures[pair] for pair in pairs], (rows, columns)), (len(number),) * 2)
    tree = minimum_spanning_tree(graph.tocsr())
    return [pair for pair, row, column in zip(pairs, rows, columns, strict=True) if tree[row, column]]


@dataclass(frozen=True, eq=False)
class _Rival:
    T: FloatArray
    tried: Sequence[Closure]
    agreeing: Sequence[Closure]
    moved_m: float
    score: float


@dataclass(frozen=True, eq=False)
class _Merged:
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
    ) -> _Merged:
        paths = merged[pair[0]], merged[pair[1]]
        voxel_m = max(voxel_size_m(clouds[robot][len(clouds[robot]) // 2]) for robot in pair)
        fixed, moved = (_standing(path, clouds[path.robot], voxel_m) for path in paths)
        return cls(pair, paths, other_ways(fixed, moved, voxel_m), voxel_m, config)

    def rivals(self, register: Register) -> Iterator[_Rival]:
        """Those that fit about as well as the map does."""
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
                yield _Rival(alike.T, tried, agreeing, self._moved_m(alike.T), own)

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


def _least_decided(
    rivals: Sequence[_Rival], accepted: Sequence[Closure], radio: PairRadio, config: Config
) -> RivalMap | None:
    """Of all that fit as well as the map: none, where what the robots measured speaks for the map against all."""
    if not rivals:
        return None
    ends = np.cumsum([0, len(accepted), *(len(rival.agreeing) for rival in rivals)])
    sets = [np.arange(start, end) for start, end in pairwise(ends.tolist())]
    shown, radio_tells = max(rivals, key=lambda rival: rival.score), ""
    if radio.measurements:
        closures = [*accepted, *(closure for rival in rivals for closure in rival.agreeing)]
        told = told_apart(sets, closures, range(len(closures)), radio, config.mutual_check)
        likeliest = next(n for n, rows in enumerate(sets) if told.kept == frozenset(rows.tolist()))
        if told.decides and likeliest == 0 and not told.contested:
            return None
        shown, radio_tells = rivals[likeliest - 1] if likeliest else shown, _radio_tells(told, likeliest == 0)
    turned_rad = float(se3.yaw(shown.T))
    return RivalMap(radio.pair, shown.moved_m, turned_rad, len(shown.agreeing), len(shown.tried), radio_tells)


def _radio_tells(told: RivalSets, for_map: bool) -> str:
    """Of a map and its rivals, where that leaves a doubt."""
    if not told.decides:
        return "nothing tells which is true, nor do the measurements of each other"
    if for_map:
        return f"the log speaks for the map as it is, yet would fit the other way better if {told.contested}"
    return f"what the robots measured of each other speaks for the other way ({in_words(told.log_odds)})"
