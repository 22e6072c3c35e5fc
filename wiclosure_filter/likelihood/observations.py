"""The measurements between two robots as a function of one planar frame transform.

Gravity-aligned frames differ by four numbers, `state = (yaw, x, y, z)`: `R_z(yaw) b + (x, y, z)` maps a position of
robot b, relative to the centre of b's antenna positions, into the odometry axes of a, relative to the centre of a's.
Centring keeps yaw and translation nearly independent, however far from its origin a robot is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, IntArray
from wiclosure.wiclosure_filter.config import RadioModel
from wiclosure.wiclosure_filter.links.links import Links

LEVEL_SIGMA_RAD = 0.01  # rad, gravity-aligned frames agree on the vertical, nearly
UNKNOWN_DISTANCE_M = 30.0  # of antennas that were not ranged, where errors across a bearing are weighed
_LEAST_SIGMA_M, _LEAST_SIGMA_RAD = 0.01, 0.002  # no radio or compass is better, whatever the log says
_CLIMBING = 0.2  # height over distance from which ranges tell heights; below, they tell as little as a mirror


@dataclass(frozen=True, eq=False)
class Observations:
    """M measurements of at most K paths, centred.

    Args:
        a, b: `(M, 3)` antenna positions relative to the centres, odometry axes.
        centre_a, centre_b: `(3,)`.
        a_receives: `(M,)`.
        range_m, range_sigma_m: `(M,)`, NaN without a range.
        direction: `(M, K, 3)` unit directions in the receiver's odometry axes; horizontal ones where `flat`.
        flat: `(M, K)` true where a path has no elevation.
        sigma, weight: `(M, K)`; weight 0 where there is no path.
        has_bearing: `(M,)`.
        independence: `(M,)` in (0, 1], by how much each measurement counts: the antennas hardly moved between some.
        yaw, yaw_sigma: `(M,)` from the robots' headings, NaN where unknown.
        near_range_m: `(M,)` distance of the antennas, measured or borrowed; NaN where nothing near in time was ranged.
        near_range_sigma_m: `(M,)`.
        index_a, index_b: `(M,)` keyframes.
        stamp_ns: `(M,)` time at a.
    """

    a: FloatArray
    b: FloatArray
    centre_a: FloatArray
    centre_b: FloatArray
    a_receives: BoolArray
    range_m: FloatArray
    range_sigma_m: FloatArray
    direction: FloatArray
    flat: BoolArray
    sigma: FloatArray
    weight: FloatArray
    has_bearing: BoolArray
    independence: FloatArray
    yaw: FloatArray
    yaw_sigma: FloatArray
    near_range_m: FloatArray
    near_range_sigma_m: FloatArray
    index_a: IntArray
    index_b: IntArray
    stamp_ns: IntArray

    def __len__(self) -> int:
        return len(self.a)

    @classmethod
    def of(cls, links: Links, radio: RadioModel) -> Observations:
        """Centres and flattens the links; M must be at least 1."""
        flat = ~np.isfinite(links.elevation)
        direction = links.direction
        direction[..., 2] = np.where(flat, 0.0, direction[..., 2])
        direction /= np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-9)
        centre_a, centre_b = links.antenna_a.mean(axis=0), links.antenna_b.mean(axis=0)
        near, near_sigma = _near_ranges(links, radio.range_partner_s)
        return cls(
            a=links.antenna_a - centre_a,
            b=links.antenna_b - centre_b,
            centre_a=centre_a,
            centre_b=centre_b,
            a_receives=links.a_receives,
            range_m=links.range_m,
            range_sigma_m=np.maximum(links.range_sigma_m, _LEAST_SIGMA_M),
            direction=direction,
            flat=flat,
            sigma=np.maximum(links.sigma, _LEAST_SIGMA_RAD),
            weight=links.weight,
            has_bearing=links.has_bearing,
            independence=independence(links, radio.static_radius_m),
            yaw=links.yaw,
            yaw_sigma=np.maximum(links.yaw_sigma, _LEAST_SIGMA_RAD),
            near_range_m=near,
            near_range_sigma_m=np.maximum(near_sigma, _LEAST_SIGMA_M),
            index_a=links.index_a,
            index_b=links.index_b,
            stamp_ns=links.stamp_a_ns,
        )

    @property
    def extents_m(self) -> tuple[float, float]:
        """How far a and b moved while they heard each other: diagonals of the boxes around their antennas."""
        a, b = (np.linalg.norm(np.ptp(p[:, :2], axis=0)) for p in (self.a, self.b))
        return float(a), float(b)

    @cached_property
    def azimuth(self) -> FloatArray:
        """`(M, K)` of the directions, rad."""
        return np.arctan2(self.direction[..., 1], self.direction[..., 0])

    @cached_property
    def all_flat(self) -> bool:
        """Whether no path has an elevation."""
        return bool(self.flat.all())

    @cached_property
    def spread_b_m2(self) -> float:
        """Mean square distance, horizontally, of b's antennas from their centre."""
        return float((self.b[:, :2] ** 2).sum(axis=1).mean())

    @cached_property
    def typical_distance_m(self) -> float:
        """Median distance of the antennas, at least 1; where nothing was ranged, how far the robots moved."""
        near = self.near_range_m[np.isfinite(self.near_range_m)]
        return max(float(np.median(near)) if len(near) else float(np.hypot(*self.extents_m)), 1.0)

    @property
    def distance_m(self) -> FloatArray:
        """`(M,)` distance of the antennas, measured or borrowed, or a usual one where nothing was ranged."""
        return np.where(np.isfinite(self.near_range_m), self.near_range_m, UNKNOWN_DISTANCE_M)

    @cached_property
    def tells_height(self) -> bool:
        """True where elevations were measured, or ranges between robots that go up and down."""
        elevated = (~self.flat & (self.weight > 0)).any()
        climbed = max(np.ptp(self.a[:, 2]), np.ptp(self.b[:, 2]))
        return bool(elevated or climbed > _CLIMBING * self.typical_distance_m)

    def subset(self, rows: IntArray) -> Observations:
        """The measurements at `rows`, about the same centres."""
        per_measurement = [f.name for f in fields(self) if f.name not in {"centre_a", "centre_b"}]
        return replace(self, **{name: getattr(self, name)[rows] for name in per_measurement})

    @classmethod
    def joined(cls, parts: Sequence[Observations]) -> Observations:
        """Measurements of several pairs of robots one after the other, each about its own centres: these are lost."""
        paths = max(part.weight.shape[1] for part in parts)
        without = {"direction": 0.0, "flat": True, "sigma": 1.0, "weight": 0.0}  # of paths that are not there
        joined = {}
        for name in (f.name for f in fields(cls)):
            values = [getattr(part, name) for part in parts]
            if name in without:
                values = [_widened(value, paths, without[name]) for value in values]
            joined[name] = np.full(3, np.nan) if name in {"centre_a", "centre_b"} else np.concatenate(values)
        return cls(**joined)

    def restricted(self, weight: FloatArray, range_m: FloatArray) -> Observations:
        """The same measurements with other path weights `(M, K)` and ranges `(M,)`."""
        return replace(self, weight=weight, range_m=range_m, has_bearing=np.asarray((weight > 0).any(axis=1)))

    def directed(self, direction: FloatArray) -> Observations:
        """The same measurements with directions `(M, K, 3)` in other axes; flat ones are laid into their plane."""
        direction = direction.copy()
        direction[..., 2] = np.where(self.flat, 0.0, direction[..., 2])
        direction /= np.maximum(np.linalg.norm(direction, axis=-1, keepdims=True), 1e-9)
        return replace(self, direction=direction)

    def frame_transform(self, state: FloatArray) -> FloatArray:
        """`T_a_b (..., 4, 4)` of states `(..., 4)`."""
        T = se3.from_yaw(state[..., 0], state[..., 1:] + self.centre_a)
        T[..., :3, 3] -= np.einsum("...ij,j->...i", T[..., :3, :3], self.centre_b)
        return T

    def state(self, T_a_b: FloatArray) -> FloatArray:
        """The state `(4,)` of a frame transform; its roll and pitch are lost."""
        return np.concatenate([[se3.yaw(T_a_b)], se3.transform(T_a_b, self.centre_b) - self.centre_a])


def _widened(values: np.ndarray, paths: int, filling: float) -> np.ndarray:
    """Of `(M, K, ...)`, with more paths."""
    more = (len(values), paths - values.shape[1], *values.shape[2:])
    return np.concatenate([values, np.full_like(values, filling, shape=more)], axis=1)


def independence(links: Links, radius_m: float, part: IntArray | None = None) -> FloatArray:
    """Weight `(M,)` of each measurement: one over how many of its kind, and of its `part (M,)`, are of the same place.

    Where robots stand still, every measurement sees the same reflections: a hundred of them prove no more than one
    that the path which they share is the direct one.
    """
    if radius_m <= 0 or len(links) == 0:
        return np.ones(len(links))
    places = np.concatenate([links.antenna_a - links.antenna_a[0], links.antenna_b - links.antenna_b[0]], axis=1)
    of_part = np.zeros(len(links), np.int64) if part is None else part
    kind = np.column_stack([links.a_receives, links.has_range, links.has_bearing, of_part])
    cell = np.column_stack([np.floor(places / radius_m + 0.5), kind])
    _, group, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(1.0 / count[group.reshape(-1)])


def _near_ranges(links: Links, tolerance_s: float) -> tuple[FloatArray, FloatArray]:
    """Each measurement's own range, or that of the measurement nearest in time within the tolerance."""
    ranged = np.flatnonzero(links.has_range)
    if len(ranged) == 0:
        return np.full(len(links), np.nan), np.full(len(links), np.nan)
    order = ranged[np.argsort(links.stamp_a_ns[ranged], kind="stable")]
    stamps = links.stamp_a_ns[order]
    upper = np.clip(np.searchsorted(stamps, links.stamp_a_ns), 0, len(order) - 1)
    lower = np.maximum(upper - 1, 0)
    to_upper, to_lower = np.abs(stamps[upper] - links.stamp_a_ns), np.abs(stamps[lower] - links.stamp_a_ns)
    partner = order[np.where(to_upper < to_lower, upper, lower)]
    partner = np.where(links.has_range, np.arange(len(links)), partner)
    close = np.abs(links.stamp_a_ns[partner] - links.stamp_a_ns) <= tolerance_s * 1e9
    moved = np.linalg.norm(links.antenna_a - links.antenna_a[partner], axis=1)
    moved += np.linalg.norm(links.antenna_b - links.antenna_b[partner], axis=1)
    near = np.where(close, links.range_m[partner], np.nan)
    return near, np.hypot(np.where(close, links.range_sigma_m[partner], np.nan), moved)
