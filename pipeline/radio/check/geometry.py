"""Where the antennas of two robots were at each measurement, each in its own odometry frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory, WirelessMeasurement


@dataclass(frozen=True, slots=True, eq=False)
class PairSamples:
    """The measurements of one pair, in order of time.

    Args:
        robots: `a` and `b`.
        stamps_ns: `(M,)`.
        ranges_m: `(M,)`, NaN where there is none.
        sigmas_m: `(M,)`, NaN where there is no range.
        arms_a, arms_b: `(M, 3)` antennas in the bodies' frames.
        azimuths_rad: `(M,)` of the strongest path, NaN where there is none.
        a_received: `(M,)` whether a measured, and b was measured.
    """

    robots: tuple[str, str]
    stamps_ns: IntArray
    ranges_m: FloatArray
    sigmas_m: FloatArray
    arms_a: FloatArray
    arms_b: FloatArray
    azimuths_rad: FloatArray
    a_received: BoolArray

    def select(self, chosen: BoolArray | IntArray) -> PairSamples:
        """Some of the measurements."""
        return PairSamples(
            self.robots,
            self.stamps_ns[chosen],
            self.ranges_m[chosen],
            self.sigmas_m[chosen],
            self.arms_a[chosen],
            self.arms_b[chosen],
            self.azimuths_rad[chosen],
            self.a_received[chosen],
        )

    def covered(self, trajectories: Mapping[str, Trajectory], shift_ns: int = 0) -> BoolArray:
        """`(M,)` whether both trajectories have the time, the stamps moved by `shift_ns`."""
        a, b = (trajectories[robot] for robot in self.robots)
        return a.covers(self.stamps_ns + shift_ns) & b.covers(self.stamps_ns + shift_ns)

    def antennas(self, trajectories: Mapping[str, Trajectory], shift_ns: int = 0) -> tuple[FloatArray, FloatArray]:
        """`(M, 3)` antenna positions of a and b, each in its own odometry frame, metres."""
        found = []
        for robot, arms in zip(self.robots, (self.arms_a, self.arms_b), strict=True):
            poses = trajectories[robot].at(self.stamps_ns + shift_ns)
            found.append(poses[:, :3, 3] + np.einsum("mij,mj->mi", poses[:, :3, :3], arms))
        return found[0], found[1]


def pair_samples(measurements: Sequence[WirelessMeasurement]) -> dict[tuple[str, str], PairSamples]:
    """The measurements by pair of robots, names sorted."""
    pairs: dict[tuple[str, str], list[WirelessMeasurement]] = {}
    for m in measurements:
        first, second = sorted((m.receiver, m.transmitter))
        pairs.setdefault((first, second), []).append(m)
    return {robots: _samples(robots, pairs[robots]) for robots in sorted(pairs)}


def _samples(robots: tuple[str, str], measurements: list[WirelessMeasurement]) -> PairSamples:
    measurements = sorted(measurements, key=lambda m: m.stamp_ns)
    a_received = np.array([m.receiver == robots[0] for m in measurements], bool)
    arms = np.array([(m.lever_arm_receiver, m.lever_arm_transmitter) for m in measurements], float)
    strongest = [max(m.paths, key=lambda path: path.weight).azimuth if m.paths else np.nan for m in measurements]
    return PairSamples(
        robots=robots,
        stamps_ns=np.array([m.stamp_ns for m in measurements], np.int64),
        ranges_m=np.array([np.nan if m.range_m is None else m.range_m for m in measurements], float),
        sigmas_m=np.array([np.nan if m.range_sigma_m is None else m.range_sigma_m for m in measurements], float),
        arms_a=np.where(a_received[:, None], arms[:, 0], arms[:, 1]),
        arms_b=np.where(a_received[:, None], arms[:, 1], arms[:, 0]),
        azimuths_rad=np.array(strongest, float),
        a_received=a_received,
    )
