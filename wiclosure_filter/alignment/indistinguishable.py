"""Which blunders would fit as well: alignments that the same measurements allow if they are not what the log claims.

Robots that move in parallel see each other always in one direction and at one distance.  Then a turned, mirrored or
reversed azimuth, swapped names and ranges in feet all fit as well as the truth, each with an alignment of its own.  No
fit tells these apart, but the geometry tells that it cannot: a blunder turns the displacements between the robots, and
the best rigid transform misses the turned ones by a chi-square that is known beforehand.  Compasses tell how the frames
are turned: what would turn them contradicts these, unless one of them is off.

Nor does a fit tell a robot from its image in a wall that hides it: the image moves as the robot's odometry does in a
mirror, and a robot that drives straight looks the same there.  Where the wall is, and so the robot, nothing tells.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import i0e

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, FloatArray
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Explanation, Mixture
from wiclosure.wiclosure_filter.links.links import Links

ComplexArray: TypeAlias = NDArray[np.complex128]

_FEET_M = 0.3048
_AGREES, _MOST, _RESERVE = 0.5, 50.0, 0.1
_REFUTED = 3.0  # natural logarithm of the odds up to which noise, not geometry, speaks against a reading
_UNKNOWN_M2 = 1e8  # variance of what was not measured
_TURNED_RAD = float(np.radians(20.0))
_RARE, USUAL, REFLECTED = 0.005, 0.02, 0.03  # shares of logs; the last of walls that hide b throughout

MOVED_ALIKE = "the robots moved so that the measurements would fit as well, but put them elsewhere, if"
"""How the sentence begins where nothing is known to be wrong."""


@dataclass(frozen=True, slots=True)
class Blunder:
    """One way in which a log may be misread: what was measured is what this makes of it.

    Args:
        clause: what was wrong, after "if".
        prior: share of logs.
        sign, offset_rad: azimuths are `sign * azimuth + offset_rad`.
        range_scale: ranges are so many times what the log says.
        swapped: each robot stands under the other's name.
        image: what was heard is b's image in some wall, which moves as b's odometry does in a mirror.
        compasses: whether they tell how the frames are turned: one may be off, and under swapped names each is the
            other robot's.
    """

    clause: str
    prior: float = USUAL
    sign: float = 1.0
    offset_rad: float = 0.0
    range_scale: float = 1.0
    swapped: bool = False
    image: bool = False
    compasses: bool = True


BLUNDERS = (
    Blunder("azimuths were clockwise", sign=-1.0),
    Blunder("azimuths were reversed", offset_rad=np.pi),
    Blunder("azimuths were taken from the left axis", offset_rad=np.pi / 2),
    Blunder("azimuths were taken from the right axis", offset_rad=-np.pi / 2),
    Blunder("antennas were mounted turned to the left", offset_rad=_TURNED_RAD),
    Blunder("antennas were mounted turned to the right", offset_rad=-_TURNED_RAD),
    Blunder("azimuths were clockwise from the left axis", _RARE, -1.0, np.pi / 2),
    Blunder("azimuths were clockwise from the right axis", _RARE, -1.0, -np.pi / 2),
    Blunder("azimuths were clockwise and reversed", _RARE, -1.0, np.pi),
    Blunder("ranges were in feet", range_scale=_FEET_M),
    Blunder("the robots' names were swapped", swapped=True, compasses=False),
    Blunder("a compass was off", compasses=False),
)
_IMAGE = Blunder("all of it was heard by a reflection", REFLECTED, image=True, compasses=False)
_NONE = Blunder("", 1.0)


@dataclass(frozen=True, eq=False)
class Blunders:
    """What H blunders would make of the measurements; the first is none.

    Args:
        readings: the blunders, of which the last is an image in a wall.
        chi2: `(H,)` by which the best rigid transform misses the displacements under each.
        log_compass: `(H,)` natural logarithm of how much likelier it makes what compasses tell than chance does.
        placed_b: `(H, M)` where each transform puts b's antennas in a's odometry axes, x + iy in metres.
        transforms: `(H, 2)` each as a turn of length one, and a shift in metres.
    """

    readings: tuple[Blunder, ...]
    chi2: FloatArray
    log_compass: FloatArray
    placed_b: ComplexArray
    transforms: ComplexArray

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
        prior: Prior,
    ) -> Blunders:
        """Of an alignment.

        Args:
            w: `(M, 3)` antenna a to antenna b in a's odometry axes, by the alignment.
            yaw: `(M,)` relative yaw, likewise.
            links: the measurements.
            odometry: of both robots.
            mixture: likelihood of the measurements.
            explanation: of them by the alignment; leading dimension 1.
            drift_m: `(M,)` standard deviations that a rigid transform is excused for.
            prior: what compasses tell of the relative yaw.
        """
        readings = (_NONE, *BLUNDERS, _IMAGE)
        in_receiver = np.where(links.a_receives[:, None], w[:, :2], -_turned(w[:, :2], -yaw))
        measured = _measured(in_receiver, mixture, explanation)
        in_a, in_b = zip(*_met(readings, measured, links, odometry), strict=True)
        weight = mixture.observations.independence / _variance(w, mixture, explanation, drift_m)
        scale = np.array([reading.range_scale for reading in readings])  # of the ranges' errors as well
        compass = np.exp(1j * prior.yaw) / prior.yaw_sigma**2 if np.isfinite(prior.yaw) else 0j
        pulls = np.array([compass * reading.compasses for reading in readings])
        met = np.stack(in_a), np.stack(in_b), links.antenna_b[:, :2]
        return cls(readings, *_fitted(*met, weight / scale[:, None] ** 2, pulls))

    @property
    def odds(self) -> FloatArray:
        """`(H,)` of each against none; a blunder that geometry does not refute is not held to fit worse by chance."""
        return np.asarray(np.array([reading.prior for reading in self.readings]) * np.exp(self._log_factor))

    @property
    def _log_factor(self) -> FloatArray:
        """`(H,)` natural logarithm of the same, however rare each is."""
        gained = (self.chi2[0] - self.chi2) / 2
        excused = (gained > -_REFUTED) & np.array([not reading.image for reading in self.readings])
        gained = np.where(excused, np.maximum(gained, 0.0), gained) + self.log_compass - self.log_compass[0]
        return np.asarray(np.minimum(gained, _MOST))

    def apart_m(self, row: int) -> FloatArray:
        """`(H,)` mean distance of b's path under each blunder from where another one puts it."""
        return np.asarray(np.abs(self.placed_b - self.placed_b[row]).mean(axis=1))

    @property
    def image_odds(self) -> float:
        """Of an image in a wall that hides b throughout, against none."""
        return float(self.odds[-1])

    @property
    def log_image(self) -> float:
        """Natural logarithm of how much likelier such an image makes the measurements, however rare it is."""
        return float(self._log_factor[-1])

    def likely(self, same_place_m: float, min_odds: float) -> tuple[tuple[int, ...], ...]:
        """Blunders that put b elsewhere and fit as well, by the place where they put it, the likeliest first.

        With what the log claims they hold ten times these odds against all others, since a blunder that was made after
        all may fit a little worse by chance.  An image has no place of its own.

        Args:
            same_place_m: distance up to which two alignments are one.
            min_odds: that are enough.
        """
        found, odds = [], np.where(self.apart_m(0) > same_place_m, self.odds, 0.0)
        odds[-1] = 0.0
        while odds.sum() * min_odds >= _RESERVE:
            here = self.apart_m(int(np.argmax(odds))) <= same_place_m
            rows = np.flatnonzero(here & (odds > 0.0))
            found.append(tuple(rows[np.argsort(-odds[rows])].tolist()))
            odds = np.where(here, 0.0, odds)
        return tuple(found)

    def objection(self, places: Sequence[Sequence[int]], min_odds: float) -> str:
        """That an image or the blunders at these places would fit as well, as a sentence; empty where odds are against.

        Args:
            places: as `likely` has them.
            min_odds: that are enough.
        """
        odds = self.image_odds + float(self.odds[[row for rows in places for row in rows]].sum())
        if odds * min_odds < 1.0:
            return ""
        told = [
            f"{' or '.join(self.readings[row].clause for row in rows)} ({self.apart_m(0)[rows[0]]:.0f} m)"
            for rows in places
        ]
        if self.image_odds * min_odds >= _RESERVE:
            told.append(f"{self.readings[-1].clause} (anywhere nearer)")
        return (
            f"{MOVED_ALIKE} {'; '.join(told)}. Odds {1 / odds:.0f} to 1 that none of it is so: other paths would tell"
        )

    def hypothesis(self, row: int, claimed: AlignmentHypothesis) -> AlignmentHypothesis:
        """The alignment under a blunder; `claimed` is the one without, which keeps the same paths and the height."""
        turn, shift = self.transforms[row]
        place = np.array([shift.real, shift.imag, claimed.T_a_b[2, 3]])
        return replace(
            claimed,
            T_a_b=se3.from_yaw(np.angle(turn), place),
            log_likelihood=claimed.log_likelihood + float(self.chi2[0] - self.chi2[row]) / 2,
            blunder=self.readings[row].clause,
        )


def _measured(by_alignment: FloatArray, mixture: Mixture, explanation: Explanation) -> FloatArray:
    """`(M, 2)` receiver to transmitter in the receiver's odometry axes, as measured: what an alignment says is biased.

    Where no path or range agrees with the alignment, direction or distance are the alignment's `(M, 2)`.
    """
    observations, direct = mixture.observations, explanation.direct()
    distance_m = np.linalg.norm(by_alignment, axis=1)
    ranged = np.where(explanation.in_sight[0] > _AGREES, observations.range_m, distance_m)
    seen = observations.direction[np.arange(len(direct)), np.maximum(direct, 0), :2]
    seen = np.where((direct >= 0)[:, None], seen, by_alignment)
    return np.asarray(ranged[:, None] * seen / np.maximum(np.linalg.norm(seen, axis=1), 1e-9)[:, None])


def _met(
    readings: Sequence[Blunder], measured: FloatArray, links: Links, odometry: PairOdometry
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """What each reading makes meet: points `(M, 2)` of a's odometry, and b's."""
    receives = links.a_receives[:, None]
    axes = np.arctan2(links.R_odom_axes[:, 1, 0], links.R_odom_axes[:, 0, 0])
    seen = _turned(measured, -axes)
    yaw_a, yaw_b = se3.yaw(odometry.a.poses[links.index_a]), se3.yaw(odometry.b.poses[links.index_b])
    axes_of_other = np.where(links.a_receives, yaw_b, yaw_a)
    in_a, in_b = links.antenna_a[:, :2], links.antenna_b[:, :2]
    for reading in readings:
        read = reading.range_scale * seen * [1.0, reading.sign]
        told = _turned(read, (axes_of_other if reading.swapped else axes) + reading.offset_rad)
        at_a = receives != reading.swapped
        mirror = np.array([1.0, -1.0 if reading.image else 1.0])
        yield in_a + np.where(at_a, told, 0.0), mirror * (in_b + np.where(at_a, 0.0, told))


def _variance(w: FloatArray, mixture: Mixture, explanation: Explanation, drift_m: FloatArray) -> FloatArray:
    """`(M,)` m^2, of each displacement in its vaguer direction; measurements that agree with nothing tell nothing."""
    kappa = (explanation.path[0] * mixture.kappa).sum(axis=1)
    distance_m = np.maximum(np.linalg.norm(w[:, :2], axis=1), MIN_DISTANCE_M)
    across = np.where(kappa > 0, distance_m**2 / np.maximum(kappa, 1e-9), _UNKNOWN_M2)
    along = np.where(explanation.ranged(), mixture.range_variance, _UNKNOWN_M2)
    return np.asarray(np.minimum(np.maximum(across, along), _UNKNOWN_M2) + drift_m**2)


def _fitted(
    in_a: FloatArray, in_b: FloatArray, b: FloatArray, weight: FloatArray, pulls: ComplexArray
) -> tuple[FloatArray, FloatArray, ComplexArray, ComplexArray]:
    """Best rigid transforms of `in_b (H, M, 2)` onto `in_a`: see `Blunders`, of which `b (M, 2)` is b's path.

    Displacements and compasses tell the turn as von Mises distributions do; `pulls (H,)` are the compasses', by their
    concentration, and 0 where they tell nothing.
    """
    p, q, path = (points[..., 0] + 1j * points[..., 1] for points in (in_a, in_b, b))
    total = weight.sum(axis=1, keepdims=True)
    middle_p, middle_q = ((points * weight).sum(axis=1, keepdims=True) / total for points in (p, q))
    told = ((p - middle_p) * np.conj(q - middle_q) * weight).sum(axis=1)
    free, turn = (np.exp(1j * np.angle(of))[:, None] for of in (told, told + pulls))
    chi2 = (np.abs(p - middle_p - free * (q - middle_q)) ** 2 * weight).sum(axis=1)
    log_compass = _log_i0(np.abs(told + pulls)) - _log_i0(np.abs(told)) - _log_i0(np.abs(pulls))
    shift = middle_p - turn * middle_q
    return chi2, log_compass, turn * path + shift, np.concatenate([turn, shift], axis=1)


def _log_i0(x: FloatArray) -> FloatArray:
    """Natural logarithm of the modified Bessel function of order 0, the norm of von Mises distributions over 2 pi."""
    return np.asarray(np.log(i0e(x)) + x)


def _turned(points: FloatArray, angle: FloatArray) -> FloatArray:
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = points[:, 0], points[:, 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
