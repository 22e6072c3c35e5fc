"""The links that an alignment keeps: their measurements, and the direct paths' directions with covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, FloatArray, IntArray, RadioLinks, Trajectory
from wiclosure.wiclosure_filter.likelihood.frame_prior import FramePrior
from wiclosure.wiclosure_filter.likelihood.observations import UNKNOWN_DISTANCE_M, independence
from wiclosure.wiclosure_filter.links.links import Links

# rad, where the antenna cannot tell the elevation: robots on the ground mostly see each other within 30 degrees.
UNKNOWN_ELEVATION = 0.5


@dataclass(frozen=True, eq=False)
class KeptLinks:
    """L measurements that an alignment keeps, each with the path that it takes for the direct one.

    Args:
        links: the measurements, one row each.
        direction: `(L, 3)` unit vector to the transmitter in the receiver's odometry axes; NaN without a direction.
        direction_covariance: `(L, 3, 3)` of the direction, on the tangent plane, rad^2.
    """

    links: Links
    direction: FloatArray
    direction_covariance: FloatArray

    def __len__(self) -> int:
        return len(self.links)

    @classmethod
    def of(cls, hypothesis: AlignmentHypothesis, links: Links) -> KeptLinks:
        """Those of the links that `hypothesis.paths_kept` names."""
        path_of = dict(hypothesis.paths_kept)
        kept = np.flatnonzero([int(m) in path_of for m in links.measurement])
        links = links.subset(kept)
        path = np.array([path_of[int(m)] for m in links.measurement], np.int64)
        chosen = links.path == np.where(path >= 0, path, -2)[:, None]
        direction, covariance = _directions(links, np.argmax(chosen, axis=1))
        direction[~chosen.any(axis=1)] = np.nan
        return cls(links, direction, covariance)

    def subset(self, rows: IntArray) -> KeptLinks:
        """The links at `rows`."""
        return KeptLinks(self.links.subset(rows), self.direction[rows], self.direction_covariance[rows])

    def thinned(self, most: int) -> KeptLinks:
        """At most so many links, evenly over the time."""
        if len(self) <= most:
            return self
        rows = np.unique(np.linspace(0, len(self) - 1, most).round().astype(np.int64))
        return self.subset(rows)

    def by_place(self, radius_m: float) -> KeptLinks:
        """The same with those of one place counted as one, as an alignment counts them: repeats are no news."""
        share = independence(self.links, radius_m)
        links = replace(self.links, range_sigma_m=self.links.range_sigma_m / np.sqrt(share))
        return KeptLinks(links, self.direction, self.direction_covariance / share[:, None, None])

    def for_graph(self, T_a_b: FloatArray, level: FloatArray, trajectories: Mapping[str, Trajectory]) -> RadioLinks:
        """The same between keyframes.

        Args:
            T_a_b: `(4, 4)` the alignment that keeps them.
            level: `(6, 6)` covariance of what is known of it otherwise.
            trajectories: keyframes of both robots.
        """
        links = self.links
        a, b = (
            trajectories[robot].poses[index, :3, :3]
            for robot, index in ((links.robot_a, links.index_a), (links.robot_b, links.index_b))
        )
        R_keyframe_odom = np.swapaxes(np.where(links.a_receives[:, None, None], a, b), 1, 2)
        return RadioLinks(
            links.robot_a,
            links.robot_b,
            T_a_b,
            level,
            links.index_a,
            links.index_b,
            links.antenna_keyframe_a,
            links.antenna_keyframe_b,
            links.a_receives,
            links.range_m,
            links.range_sigma_m,
            np.einsum("lij,lj->li", R_keyframe_odom, self.direction),
            R_keyframe_odom @ self.direction_covariance @ np.swapaxes(R_keyframe_odom, 1, 2),
        )

    def height_sigma_m(self, prior: FramePrior, a: Trajectory, b: Trajectory) -> float | None:
        """How differently high the robots may be where they heard each other; None where the links may tell that."""
        ranged = self.links.range_m[np.isfinite(self.links.range_m)]
        elevated = np.isfinite(self.links.elevation).any()
        if elevated or len(self) == 0:
            return None
        return prior.height_sigma_m(a, b, float(np.median(ranged)) if len(ranged) else UNKNOWN_DISTANCE_M)

    def misfit(self, T_world_a: FloatArray, T_world_b: FloatArray) -> float:
        """Median residual of ranges and bearings in their standard deviations; near 0.7 where all is well.

        Args:
            T_world_a: `(L, 4, 4)` frames with a's odometry axes and their origins at its antennas.
            T_world_b: the same of b.
        """
        to_b, to_a = (se3.between(*pair)[:, :3, 3] for pair in ((T_world_a, T_world_b), (T_world_b, T_world_a)))
        seen = np.where(self.links.a_receives[:, None], to_b, to_a)
        distance = np.linalg.norm(seen, axis=1)
        of_range = np.abs(distance - self.links.range_m) / self.links.range_sigma_m
        known = np.isfinite(self.direction).all(axis=1)
        u, covariance = self.direction[known], self.direction_covariance[known]
        off = seen[known] / np.maximum(distance[known], 1e-9)[:, None] - u
        off -= np.einsum("li,li->l", u, off)[:, None] * u
        # On the tangent plane the covariance has rank two; along u there is nothing left to divide.
        whitened = np.linalg.solve(covariance + u[:, :, None] * u[:, None, :], off[:, :, None])[:, :, 0]
        of_bearing = np.sqrt(np.maximum(np.einsum("li,li->l", off, whitened), 0.0))
        residuals = np.concatenate([of_range[np.isfinite(of_range)], of_bearing])
        return float(np.median(residuals)) if len(residuals) else 0.0


def _directions(links: Links, column: IntArray) -> tuple[FloatArray, FloatArray]:
    """Direction `(L, 3)` and its covariance `(L, 3, 3)` of one path of each measurement, in odometry axes."""
    row = np.arange(len(links))
    direction = links.direction[row, column]
    sigma, elevation = links.sigma[row, column], links.elevation[row, column]
    up = links.R_odom_axes[:, :, 2]
    sideways = np.cross(up, direction)
    length = np.linalg.norm(sideways, axis=1, keepdims=True)
    # Straight up no azimuth is left: any two directions across will do.
    spare = links.R_odom_axes[:, :, 0]
    sideways = np.where(length > 1e-6, sideways / np.maximum(length, 1e-6), spare)
    upward = np.cross(direction, sideways)
    across = sigma * np.maximum(np.cos(np.nan_to_num(elevation)), 0.1)
    upright = np.where(np.isnan(elevation), UNKNOWN_ELEVATION, sigma)
    covariance = (across**2)[:, None, None] * sideways[:, :, None] * sideways[:, None, :]
    covariance += (upright**2)[:, None, None] * upward[:, :, None] * upward[:, None, :]
    return direction, covariance
