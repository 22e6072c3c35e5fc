"""Frame transforms that small sets of measurements would allow: where consensus looks for the right one.

A path with a range is a *correspondence*: a point of a's frame and the point of b's frame that must meet it.  One is
enough where the relative yaw is known (headings, reciprocal bearings), two give the yaw.  Without ranges, or without
bearings, the yaw runs through a grid and rays or circles of two measurements are intersected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.likelihood.observations import Observations

_SEED = 20_231  # proposals are drawn the same way every time: equal input gives equal output
_YAW_GRID = 72
_YAW_OFFSETS = (-1.0, 0.0, 1.0)  # known yaws are tried at these multiples of their sigma, too


@dataclass(frozen=True, eq=False)
class Correspondences:
    """C paths whose transmitter's place is known in both frames, up to the frame transform.

    Args:
        row, column: `(C,)` measurement and path.
        a, b: `(C, 3)` the same point, in a's and in b's centred odometry axes.
        sigma_m: `(C,)` how far off it may be, sideways or along.
    """

    row: IntArray
    column: IntArray
    a: FloatArray
    b: FloatArray
    sigma_m: FloatArray

    @classmethod
    def of(cls, observations: Observations) -> Correspondences:
        """Every path of every measurement with an own or borrowed range."""
        there = (observations.weight > 0) & np.isfinite(observations.near_range_m)[:, None]
        row, column = np.nonzero(there)
        reach = observations.near_range_m[row, None] * observations.direction[row, column]
        receives = observations.a_receives[row, None]
        sideways = observations.near_range_m[row] * observations.sigma[row, column]
        return cls(
            row=row,
            column=column,
            a=observations.a[row] + np.where(receives, reach, 0.0),
            b=observations.b[row] + np.where(receives, 0.0, reach),
            sigma_m=np.hypot(sideways, observations.near_range_sigma_m[row]),
        )


def from_known_yaw(points: Correspondences, yaw: float, yaw_sigma: float) -> FloatArray:
    """States `(N, 4)` from single correspondences where the relative yaw is known; none where it is NaN."""
    if not np.isfinite(yaw):
        return np.zeros((0, 4))
    tried = np.repeat([yaw + step * yaw_sigma for step in _YAW_OFFSETS], len(points.row))
    a, b = (np.tile(p, (len(_YAW_OFFSETS), 1)) for p in (points.a, points.b))
    return _meeting(tried, a, b)


def from_reciprocal(points: Correspondences, observations: Observations, partner: IntArray, limit: int) -> FloatArray:
    """States from two opposite bearings at about the same time: yaw = azimuth_ab + pi - azimuth_ba.

    Args:
        points: all correspondences.
        observations: the measurements.
        partner: `(M,)` the opposite measurement, or -1.
        limit: how many states at most.
    """
    azimuth = np.arctan2(observations.direction[..., 1], observations.direction[..., 0])
    forward = observations.a_receives[points.row] & (partner[points.row] >= 0)
    here = np.flatnonzero(forward)
    there = partner[points.row[here]]
    paths = observations.weight.shape[1]
    here, there = np.repeat(here, paths), np.repeat(there, paths)
    column = np.tile(np.arange(paths), len(here) // max(paths, 1))
    real = observations.weight[there, column] > 0
    here, there, column = (_spread(x[real], limit) for x in (here, there, column))
    yaw = azimuth[points.row[here], points.column[here]] + np.pi - azimuth[there, column]
    return _meeting(yaw, points.a[here], points.b[here])


def from_pairs(points: Correspondences, rows: IntArray, limit: int) -> FloatArray:
    """States from two correspondences of different measurements among `rows`, the best conditioned of many drawn."""
    among = np.flatnonzero(np.isin(points.row, rows))
    first, second = _pairs_of(len(among), 4 * limit)
    first, second = among[first], among[second]
    base_a, base_b = points.a[second] - points.a[first], points.b[second] - points.b[first]
    length_a, length_b = np.linalg.norm(base_a[:, :2], axis=1), np.linalg.norm(base_b[:, :2], axis=1)
    sigma = np.hypot(points.sigma_m[first], points.sigma_m[second])
    possible = (points.row[first] != points.row[second]) & (np.abs(length_a - length_b) < 3 * sigma)
    possible &= np.minimum(length_a, length_b) > 0.05
    vague = sigma / np.maximum(np.sqrt(length_a * length_b), 1e-9)
    best = np.flatnonzero(possible)
    best = best[np.argsort(vague[best], kind="stable")[:limit]]
    first, second = first[best], second[best]
    yaw = np.arctan2(base_a[best, 1], base_a[best, 0]) - np.arctan2(base_b[best, 1], base_b[best, 0])
    share = (points.sigma_m[second] ** 2 / sigma[best] ** 2)[:, None]  # the surer of the two draws the transform
    middle_a = share * points.a[first] + (1 - share) * points.a[second]
    middle_b = share * points.b[first] + (1 - share) * points.b[second]
    return _meeting(yaw, middle_a, middle_b)


def from_circles(observations: Observations, rows: IntArray, yaws: FloatArray, limit: int) -> FloatArray:
    """States from the ranges of two measurements, the yaw running through `yaws`."""
    ranged = rows[np.isfinite(observations.range_m[rows])]
    first, second, yaw = _pairs_and_yaws(ranged, yaws, limit // 2)
    centre_1, centre_2 = _centre(observations, first, yaw), _centre(observations, second, yaw)
    r_1, r_2 = observations.range_m[first], observations.range_m[second]
    base = (centre_2 - centre_1)[:, :2]
    length = np.linalg.norm(base, axis=1)
    along = (length**2 + r_1**2 - r_2**2) / (2 * np.maximum(length, 1e-9))
    height_2 = r_1**2 - along**2
    slack = 3 * np.hypot(observations.range_sigma_m[first], observations.range_sigma_m[second])
    possible = (length > slack / 3) & (height_2 > -((slack + 1) ** 2))
    unit = base / np.maximum(length, 1e-9)[:, None]
    normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    foot = centre_1[:, :2] + along[:, None] * unit
    off = np.sqrt(np.maximum(height_2, 0.0))[:, None] * normal
    z = (centre_1[:, 2] + centre_2[:, 2]) / 2
    states = [np.column_stack([yaw, foot + side * off, z])[possible] for side in (1.0, -1.0)]
    return np.concatenate(states)


def from_rays(observations: Observations, rows: IntArray, yaws: FloatArray, limit: int) -> FloatArray:
    """States from the bearings of two measurements, the yaw running through `yaws`."""
    row, column = np.nonzero(observations.weight > 0)
    among = np.isin(row, rows)
    row, column = row[among], column[among]
    first, second, yaw = _pairs_and_yaws(np.arange(len(row)), yaws, limit)
    centre_1, centre_2 = _centre(observations, row[first], yaw), _centre(observations, row[second], yaw)
    ray_1 = _ray(observations, row[first], column[first], yaw)
    ray_2 = _ray(observations, row[second], column[second], yaw)
    base = centre_2 - centre_1
    cross = ray_1[:, 0] * ray_2[:, 1] - ray_1[:, 1] * ray_2[:, 0]
    safe = np.where(np.abs(cross) > 1e-3, cross, np.inf)
    s_1 = (base[:, 0] * ray_2[:, 1] - base[:, 1] * ray_2[:, 0]) / safe
    s_2 = (base[:, 0] * ray_1[:, 1] - base[:, 1] * ray_1[:, 0]) / safe
    possible = (s_1 > 0) & (s_2 > 0) & (row[first] != row[second])
    meeting = centre_1 + s_1[:, None] * ray_1
    return np.asarray(np.column_stack([yaw, meeting])[possible])


def yaw_grid() -> FloatArray:
    """Yaws all around."""
    return np.linspace(-np.pi, np.pi, _YAW_GRID, endpoint=False)


def _centre(observations: Observations, rows: IntArray, yaw: FloatArray) -> FloatArray:
    """The translation that would put both antennas of a measurement in one place."""
    return np.asarray(observations.a[rows] - _turned(yaw, observations.b[rows]))


def _ray(observations: Observations, rows: IntArray, columns: IntArray, yaw: FloatArray) -> FloatArray:
    """Direction in which the translation may go from `_centre`, by one path."""
    u = observations.direction[rows, columns]
    return np.asarray(np.where(observations.a_receives[rows, None], u, -_turned(yaw, u)))


def _meeting(yaw: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """States that turn by `yaw` and bring `b` onto `a`."""
    return np.column_stack([yaw, a - _turned(yaw, b)])


def _turned(yaw: FloatArray, points: FloatArray) -> FloatArray:
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x, y, z = points.T
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y, z])


def _pairs_of(count: int, limit: int) -> tuple[IntArray, IntArray]:
    """All pairs of `count` things, or `limit` of them drawn at random."""
    if count * (count - 1) // 2 <= limit:
        first, second = np.triu_indices(count, 1)
        return first.astype(np.int64), second.astype(np.int64)
    draw = np.random.default_rng(_SEED).integers(0, count, (2, limit))
    return draw[0], draw[1]


def _pairs_and_yaws(items: IntArray, yaws: FloatArray, limit: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of items, each with every yaw, `limit` triples at most."""
    first, second = _pairs_of(len(items), max(1, limit // len(yaws)))
    different = first != second
    first, second = items[first[different]], items[second[different]]
    return np.repeat(first, len(yaws)), np.repeat(second, len(yaws)), np.tile(yaws, len(first))


def _spread(values: IntArray, limit: int) -> IntArray:
    """At most `limit` of the values, evenly spread."""
    if len(values) <= limit:
        return values
    return values[np.linspace(0, len(values) - 1, limit).astype(np.int64)]
