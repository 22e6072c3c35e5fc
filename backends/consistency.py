"""Which closures of a pair of robots agree, grown row by row as closures arrive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.cycles import Cycles, mahalanobis_squared
from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory

Levels = NDArray[np.uint8]
NEVER = 255


@dataclass(frozen=True, eq=False)
class PairGraph:
    """The closures of one pair of robots and how often sigma must be doubled until they agree.

    Args:
        z: the closures; the same robot twice for those within one robot.
        levels: `(N, N)` symmetric; 0 agrees as stated, 1 with sigma doubled, ..., 255 never.
        own: `(N,)`: the same for each closure within one robot against the robot's odometry; 0 between robots.
    """

    z: ClosureSet
    levels: Levels
    own: Levels

    @classmethod
    def of(cls, z: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PcmSettings) -> PairGraph:
        """All rows."""
        empty = cls(z.subset(np.zeros(0, np.int64)), np.zeros((0, 0), np.uint8), np.zeros(0, np.uint8))
        return empty.grown(z, trajectories, settings)

    def grown(self, new: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PcmSettings) -> PairGraph:
        """With more closures: one row each; those that are there are not computed again."""
        z, known = self.z + new, len(self.z)
        levels = np.full((len(z), len(z)), NEVER, np.uint8)
        levels[:known, :known] = self.levels
        cycles = Cycles.of(z, trajectories)
        for row in range(max(known, 1), len(z)):
            levels[row, :row] = levels[:row, row] = _row(cycles, row, np.arange(row), settings)
        of_new = np.zeros(len(new), np.uint8) if z.between_robots else _against_odometry(new, trajectories, settings)
        return PairGraph(z, levels, np.concatenate([self.own, of_new]))

    def alive(self, level: int) -> IntArray:
        """Closures that their robot's own odometry allows, with sigma doubled `level` times."""
        return np.flatnonzero(self.own <= level)

    def consistent(self, level: int) -> BoolArray:
        """Which of those `(K, K)` agree, diagonal false."""
        alive = self.alive(level)
        return self.levels[np.ix_(alive, alive)] <= level


@cache
def chi_square_limit(probability: float) -> float:
    """Quantile of chi-square with the 6 degrees of freedom of a rigid transform."""
    return float(chi2.ppf(probability, 6))


def doublings(settings: PcmSettings) -> int:
    """How often sigma may be doubled."""
    return int(np.log2(settings.max_scale))


def _row(cycles: Cycles, row: int, others: IntArray, settings: PcmSettings) -> Levels:
    """Levels `(M,)` at which the closures `others` agree with the closure `row`."""
    if settings.metric == "mahalanobis":
        widest = chi_square_limit(settings.probability) * 4.0 ** doublings(settings)
        return _levels(cycles.mahalanobis_squared(row, others, limit=widest), settings)
    legacy = settings.cycle == "legacy"
    T = cycles.legacy_transforms(row, others) if legacy else cycles.closing_transforms(row, others)
    return _unit_levels(se3.log(T), settings)


def _against_odometry(z: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PcmSettings) -> Levels:
    """Levels `(N,)` at which closures within one robot are within its odometry's drift."""
    odometry = trajectories[z.robot_a]
    x = odometry.relative_pose(z.index_a, z.index_b)
    error = se3.log(se3.between(z.T_a_b, x))
    if settings.metric == "unit":
        return _unit_levels(error, settings)
    sigma = se3.inverse_covariance(z.T_a_b, z.covariance)
    sigma = se3.compose_covariance(sigma, x, odometry.relative_covariance(z.index_a, z.index_b))
    return _levels(mahalanobis_squared(error, sigma), settings)


def _levels(squared: FloatArray, settings: PcmSettings) -> Levels:
    times = np.sqrt(squared / chi_square_limit(settings.probability))
    needed = np.where(times < 1, 0.0, np.floor(np.log2(np.maximum(times, 1.0))) + 1)  # a distance at the limit is out
    return np.where(needed <= doublings(settings), needed, NEVER).astype(np.uint8)


def _unit_levels(error: FloatArray, settings: PcmSettings) -> Levels:
    return np.where(np.linalg.norm(error, axis=1) < settings.unit_threshold, 0, NEVER).astype(np.uint8)
