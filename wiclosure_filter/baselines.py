"""Candidate filters to compare with: none, random, ground truth, and range alone.

`random` and `oracle` tell good pruning from less work; `range-gate` is what a UWB radio without direction allows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import ClassVar

import numpy as np

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.types import (
    CandidatePairs,
    FilterResult,
    FloatArray,
    IntArray,
    PredictionKind,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
    robot_pairs,
)
from wiclosure.wiclosure_filter.search.pairs import all_pairs, count_pairs, from_codes

TRUTH_COVARIANCE = np.diag(np.square([0.018, 0.018, 0.018, 0.42, 0.42, 0.42]))
"""Of a relative pose by ground truth, which recorded is good to a metre and some degrees: a measurement 2 m or 5
degrees off contradicts it (99.9 %), which is what the evaluation calls false."""

MISFIT = 0.3
"""Share of the motion up to which truth and odometry count as alike: drift stays below, other axes do not."""


class PairwiseFilter(ABC):
    """A filter that looks at one pair of robots at a time."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Registry name."""

    @abstractmethod
    def between(self, a: Trajectory, b: Trajectory, wireless: WirelessLog) -> CandidatePairs:
        """Kept pairs of two robots."""

    def diagnosis(self) -> tuple[str, ...]:
        """Sentences for the user."""
        return ()

    def candidates(self, trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> FilterResult:
        """Kept pairs of all pairs of robots; see `wiclosure.interfaces.CandidateFilter`."""
        start = perf_counter()
        pairs = tuple(
            self.between(trajectories[a], trajectories[b], wireless) for a, b in robot_pairs(list(trajectories))
        )
        return FilterResult(
            filter_name=self.name,
            pairs=pairs,
            pairs_total=count_pairs(trajectories),
            diagnosis=self.diagnosis(),
            seconds=perf_counter() - start,
        )


class NoFilter(PairwiseFilter):
    """Keeps every pair: what a pipeline without radio has to compare."""

    name = "none"

    def between(self, a: Trajectory, b: Trajectory, wireless: WirelessLog) -> CandidatePairs:
        """All pairs."""
        return all_pairs(a.robot, len(a), b.robot, len(b))


class RandomFilter(PairwiseFilter):
    """Keeps a share of the pairs, drawn at random: the same work as a filter, without its knowledge.

    Args:
        keep_rate: share of the pairs that is kept.
        seed: the same seed keeps the same pairs.
    """

    name = "random"

    def __init__(self, keep_rate: float, seed: int) -> None:
        self.keep_rate = keep_rate
        self.seed = seed

    def between(self, a: Trajectory, b: Trajectory, wireless: WirelessLog) -> CandidatePairs:
        """A random share of the pairs, none twice."""
        total = len(a) * len(b)
        # One stream a robot pair, so that the draw does not depend on the other robots.
        stream = list(f"{a.robot}\0{b.robot}".encode())
        rng = np.random.default_rng([self.seed, *stream])
        codes = rng.choice(total, size=round(self.keep_rate * total), replace=False, shuffle=False)
        return from_codes(a.robot, b.robot, np.sort(codes).astype(np.int64), len(b))


@dataclass(frozen=True, eq=False)
class TruePoses:
    """Predicts relative poses by ground truth; `wiclosure.types.RelativePosePredictor`.

    Args:
        poses: `(N, 4, 4)` true `T_world_body` of the keyframes, by robot.
    """

    poses: Mapping[str, FloatArray]
    kind: ClassVar[PredictionKind] = PredictionKind.POSE

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """True `T_a_b (M, 4, 4)`, and the covariance `(M, 6, 6)` of recorded ground truth."""
        T_a_b = se3.between(self.poses[robot_a][index_a], self.poses[robot_b][index_b])
        return T_a_b, np.broadcast_to(TRUTH_COVARIANCE, (len(index_a), 6, 6))


class OracleFilter(PairwiseFilter):
    """Keeps the pairs that are near in truth, and predicts their true poses: what a perfect filter would do.

    A filter that knows where the robots are tells the registration where to start and what to refuse, which in
    symmetric halls counts for more than the choice of pairs; so the upper bound must tell it too.

    Args:
        ground_truth: true trajectories of all robots in one frame, covering the keyframes' time.
        radius_m: pairs nearer than this are kept.
    """

    name = "oracle"

    def __init__(self, ground_truth: Mapping[str, Trajectory], radius_m: float) -> None:
        self.ground_truth = ground_truth
        self.radius_m = radius_m

    def between(self, a: Trajectory, b: Trajectory, wireless: WirelessLog) -> CandidatePairs:
        """Pairs within the radius."""
        from scipy.spatial import KDTree

        near = KDTree(self._true_positions(a)).sparse_distance_matrix(
            KDTree(self._true_positions(b)), self.radius_m, output_type="coo_matrix"
        )
        codes = np.sort(near.row.astype(np.int64) * len(b) + near.col)
        kept = from_codes(a.robot, b.robot, codes, len(b))
        if not (self._in_lidar_axes(a) and self._in_lidar_axes(b)):
            return kept
        return replace(
            kept,
            overlap_probability=np.ones(len(kept)),
            predictor=TruePoses({keyframes.robot: self._true_poses(keyframes) for keyframes in (a, b)}),
        )

    def candidates(self, trajectories: Mapping[str, Trajectory], wireless: WirelessLog) -> FilterResult:
        """Near pairs of all pairs of robots; says so where ground truth cannot predict poses."""
        found = super().candidates(trajectories, wireless)
        return replace(
            found,
            diagnosis=tuple(
                f"oracle: the orientations of {robot}'s ground truth are not the LiDAR's, so it predicts no poses there"
                for robot, keyframes in trajectories.items()
                if not self._in_lidar_axes(keyframes)
            ),
        )

    def _in_lidar_axes(self, keyframes: Trajectory) -> bool:
        """Whether truth and odometry move alike, each in its own body's axes."""
        ends = np.unique(np.linspace(0, len(keyframes) - 1, 20, dtype=np.int64))
        moved, moved_truth = (
            se3.between(poses[ends[:-1]], poses[ends[1:]])[:, :3, 3]
            for poses in (keyframes.poses, self._true_poses(keyframes))
        )
        return bool(np.linalg.norm(moved - moved_truth) <= MISFIT * np.linalg.norm(moved))

    def _true_positions(self, keyframes: Trajectory) -> FloatArray:
        return self._true_poses(keyframes)[:, :3, 3]

    def _true_poses(self, keyframes: Trajectory) -> FloatArray:
        if keyframes.robot not in self.ground_truth:
            raise InputError(
                f"the oracle filter has no ground truth of {keyframes.robot}; give ground_truth for every robot"
            )
        return self.ground_truth[keyframes.robot].at(keyframes.stamps_ns)


class RangeGateFilter(PairwiseFilter):
    """Keeps pairs around every measurement whose range is short: UWB alone, as Co-LRIO proposes closures.

    It finds only places where both robots are at the same time, and needs no alignment.

    Args:
        max_range_m: ranges up to this propose pairs.
        window_m: metres travelled before and after the measurement that are proposed on both robots.
    """

    name = "range-gate"

    def __init__(self, max_range_m: float, window_m: float) -> None:
        self.max_range_m = max_range_m
        self.window_m = window_m

    def diagnosis(self) -> tuple[str, ...]:
        """Says what this filter cannot find."""
        return ("range-gate keeps only pairs around short ranges: places visited at different times are not found",)

    def between(self, a: Trajectory, b: Trajectory, wireless: WirelessLog) -> CandidatePairs:
        """Pairs within the window around every short range."""
        codes = [np.zeros(0, np.int64)]
        for measurement in wireless.measurements:
            if {measurement.receiver, measurement.transmitter} != {a.robot, b.robot}:
                continue
            if measurement.range_m is None or measurement.range_m > self.max_range_m:
                continue
            index_a, index_b = (self._window(robot, measurement) for robot in (a, b))
            codes.append((index_a[:, None] * len(b) + index_b).ravel())
        return from_codes(a.robot, b.robot, np.unique(np.concatenate(codes)), len(b))

    def _window(self, keyframes: Trajectory, measurement: WirelessMeasurement) -> IntArray:
        """Keyframes within the window of travelled distance around the measurement."""
        stamp_ns = measurement.stamp_ns
        if measurement.transmitter == keyframes.robot and measurement.transmitter_stamp_ns is not None:
            stamp_ns = measurement.transmitter_stamp_ns
        if not keyframes.covers(np.array([stamp_ns]))[0]:
            return np.zeros(0, np.int64)
        centre = keyframes.distance[keyframes.nearest(np.array([stamp_ns]))[0]]
        return np.flatnonzero(np.abs(keyframes.distance - centre) <= self.window_m).astype(np.int64)
