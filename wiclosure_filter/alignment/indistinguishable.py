"""Which blunders would fit as well: alignments that the same measurements allow if they are not what the log claims.

Robots that move in parallel see each other always in one direction and at one distance.  Then a turned, mirrored or
reversed azimuth, swapped names and ranges in feet all fit as well as the truth, each with an alignment of its own.  No
fit tells these apart, but the geometry tells that it cannot: a blunder turns the displacements between the robots, and
the best rigid transform misses the turned ones by a chi-square that is known beforehand.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Explanation, Mixture
from wiclosure.wiclosure_filter.links.links import Links

_FEET_M = 0.3048
_UNKNOWN_M2 = 1e8  # variance of what was not measured
_TURNED_RAD = float(np.radians(20.0))
_RARE, _USUAL, _MIRRORED = 0.005, 0.02, 0.05  # shares of logs; a wall that hides the direct path mirrors as well
# Sign and offset of azimuths as they may have been taken.
_AZIMUTHS = {
    "azimuths were clockwise, or of a reflection": (-1.0, 0.0, _MIRRORED),
    "azimuths were reversed": (1.0, np.pi, _USUAL),
    "azimuths were taken from the left axis": (1.0, np.pi / 2, _USUAL),
    "azimuths were taken from the right axis": (1.0, -np.pi / 2, _USUAL),
    "antennas were mounted turned to the left": (1.0, _TURNED_RAD, _USUAL),
    "antennas were mounted turned to the right": (1.0, -_TURNED_RAD, _USUAL),
    "azimuths were clockwise from the left axis": (-1.0, np.pi / 2, _RARE),
    "azimuths were clockwise from the right axis": (-1.0, -np.pi / 2, _RARE),
    "azimuths were clockwise and reversed": (-1.0, np.pi, _RARE),
}


@dataclass(frozen=True, eq=False)
class Blunders:
    """What H blunders would make of the measurements; the first is none.

    Args:
        names: of the blunders, as clauses.
        prior: `(H,)` share of logs that have each.
        chi2: `(H,)` by which the best rigid transform misses the displacements under each.
        apart_m: `(H,)` mean distance of b's path under each from where the alignment puts it.
    """

    names: tuple[str, ...]
    prior: FloatArray
    chi2: FloatArray
    apart_m: FloatArray

    @classmethod
    def of(
        cls,
        w: FloatArray,
        yaw: FloatArray,
        links: Links,
        odometry: PairOdometry,
        mixture: Mixture,
        explanation: Explanation,
        drift_m: FloatArray,
    ) -> Blunders:
        """Of an alignment.

        Args:
            w: `(M, 3)` antenna a to antenna b in a's odometry axes.
            yaw: `(M,)` relative yaw.
            links: the measurements.
            odometry: of both robots.
            mixture: likelihood of the measurements.
            explanation: of them by the alignment; leading dimension 1.
            drift_m: `(M,)` standard deviations that a rigid transform is excused for.
        """
        names, prior, in_a, in_b = zip(*_readings(w, yaw, links, odometry), strict=True)
        weight = mixture.observations.independence / _variance(w, mixture, explanation, drift_m)
        chi2, placed_b = _fitted(np.stack(in_a), np.stack(in_b), links.antenna_b[:, :2], weight)
        return cls(names, np.array(prior), chi2, np.linalg.norm(placed_b - placed_b[0], axis=2).mean(axis=1))

    def objection(self, same_place_m: float, min_odds: float) -> str:
        """That a blunder which puts b elsewhere would fit as well, as a sentence; empty where the odds are against it.

        Args:
            same_place_m: distance up to which two alignments are one.
            min_odds: that are enough.
        """
        missed = np.maximum(self.chi2 - self.chi2[0], 0.0)
        odds = np.where(self.apart_m > same_place_m, self.prior * np.exp(-missed / 2), 0.0)
        if odds.sum() * min_odds < 1.0:
            return ""
        likeliest = int(np.argmax(odds))
        return (
            f"the robots moved so that the measurements would fit as well if {self.names[likeliest]}, which puts them"
            f" {self.apart_m[likeliest]:.0f} m elsewhere (odds {1 / odds.sum():.0f} to 1): other paths would tell"
        )


def _readings(
    w: FloatArray, yaw: FloatArray, links: Links, odometry: PairOdometry
) -> Iterator[tuple[str, float, FloatArray, FloatArray]]:
    """Each way to read the measurements: name, share, points `(M, 2)` of a's odometry, and b's that meet them."""
    receives = links.a_receives[:, None]
    axes = np.arctan2(links.R_odom_axes[:, 1, 0], links.R_odom_axes[:, 0, 0])
    seen = _turned(np.where(receives, w[:, :2], -_turned(w[:, :2], -yaw)), -axes)  # in the receiver's axes

    def meeting(told: FloatArray, *, swapped: bool = False) -> tuple[FloatArray, FloatArray]:
        at_a = receives != swapped
        in_a, in_b = links.antenna_a[:, :2], links.antenna_b[:, :2]
        return in_a + np.where(at_a, told, 0.0), in_b + np.where(at_a, 0.0, told)

    yield "", 1.0, *meeting(_turned(seen, axes))
    for name, (sign, offset, prior) in _AZIMUTHS.items():
        yield name, prior, *meeting(_turned(seen * [1.0, sign], axes + offset))
    yield "ranges were in feet", _USUAL, *meeting(_FEET_M * _turned(seen, axes))
    yaw_a, yaw_b = se3.yaw(odometry.a.poses[links.index_a]), se3.yaw(odometry.b.poses[links.index_b])
    told = _turned(seen, np.where(links.a_receives, yaw_b, yaw_a))
    yield "the robots' names were swapped", _USUAL, *meeting(told, swapped=True)


def _variance(w: FloatArray, mixture: Mixture, explanation: Explanation, drift_m: FloatArray) -> FloatArray:
    """`(M,)` m^2, of each displacement in its vaguer direction; measurements that agree with nothing tell nothing."""
    kappa = (explanation.path[0] * mixture.kappa).sum(axis=1)
    distance_m = np.maximum(np.linalg.norm(w[:, :2], axis=1), MIN_DISTANCE_M)
    across = np.where(kappa > 0, distance_m**2 / np.maximum(kappa, 1e-9), _UNKNOWN_M2)
    along = np.where(explanation.ranged(), mixture.range_variance, _UNKNOWN_M2)
    return np.asarray(np.minimum(np.maximum(across, along), _UNKNOWN_M2) + drift_m**2)


def _fitted(in_a: FloatArray, in_b: FloatArray, b: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Best rigid transforms of `in_b (H, M, 2)` onto `in_a`: chi-square `(H,)`, and where they put `b (M, 2)`."""
    p, q, path = (points[..., 0] + 1j * points[..., 1] for points in (in_a, in_b, b))
    total = weight.sum()
    middle_p, middle_q = (p @ weight / total)[:, None], (q @ weight / total)[:, None]
    correlation = ((p - middle_p) * np.conj(q - middle_q)) @ weight
    turn = np.exp(1j * np.angle(correlation))[:, None]
    chi2 = np.abs(p - middle_p - turn * (q - middle_q)) ** 2 @ weight
    placed = middle_p + turn * (path - middle_q)
    return chi2, np.stack([placed.real, placed.imag], axis=-1)


def _turned(points: FloatArray, angle: FloatArray) -> FloatArray:
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = points[:, 0], points[:, 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
