"""Simulated radio between robots of known truth: UWB ranges and WiFi bearings with false paths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from wiclosure import se3
from wiclosure.types import AoaPath, FloatArray, Trajectory, WirelessLog, WirelessMeasurement


@dataclass(frozen=True)
class Radio:
    """What the radio can do.

    Args:
        every_m: metres that a receiver travels between measurements.
        reach_m: largest distance.
        range_sigma_m, aoa_sigma_rad: standard deviations.
        false_paths: per measurement, in any direction.
        absent: probability that the direct path is missing.
        reciprocal: both robots measure at the same time; otherwise only the first of each pair does.
    """

    every_m: float = 10.0
    reach_m: float = 150.0
    range_sigma_m: float = 0.5
    aoa_sigma_rad: float = np.deg2rad(10.0)
    false_paths: int = 4
    absent: float = 0.15
    reciprocal: bool = False

    def listen(self, truth: Mapping[str, Trajectory], seed: int) -> WirelessLog:
        """All measurements between robots with these true trajectories (one frame, one clock)."""
        rng = np.random.default_rng(seed)
        heard: list[WirelessMeasurement] = []
        for receiver, transmitter in permutations(truth, 2):
            if self.reciprocal or list(truth).index(receiver) < list(truth).index(transmitter):
                heard += self._link(truth[receiver], truth[transmitter], rng)
        return WirelessLog(tuple(sorted(heard, key=lambda m: m.stamp_ns)))

    def _link(
        self, receiver: Trajectory, transmitter: Trajectory, rng: np.random.Generator
    ) -> list[WirelessMeasurement]:
        stations = np.arange(0.0, receiver.distance[-1], self.every_m)
        stamps_ns = receiver.stamps_ns[np.unique(np.searchsorted(receiver.distance, stations))]
        stamps_ns = stamps_ns[transmitter.covers(stamps_ns)]
        seen = se3.between(receiver.at(stamps_ns), transmitter.at(stamps_ns))[:, :3, 3]
        distance = np.linalg.norm(seen, axis=1)
        return [
            self._measurement(int(stamp), receiver.robot, transmitter.robot, position, rng)
            for stamp, position, metres in zip(stamps_ns, seen, distance, strict=True)
            if metres <= self.reach_m
        ]

    def _measurement(
        self, stamp_ns: int, receiver: str, transmitter: str, position: FloatArray, rng: np.random.Generator
    ) -> WirelessMeasurement:
        azimuths = list(rng.uniform(-np.pi, np.pi, self.false_paths))
        if rng.uniform() >= self.absent:
            azimuths.append(np.arctan2(position[1], position[0]) + rng.normal(0, self.aoa_sigma_rad))
        paths = [
            AoaPath((float(a) + np.pi) % (2 * np.pi) - np.pi, self.aoa_sigma_rad, float(rng.uniform(0.2, 1.0)))
            for a in azimuths
        ]
        return WirelessMeasurement(
            stamp_ns,
            receiver,
            transmitter,
            range_m=abs(float(np.linalg.norm(position) + rng.normal(0, self.range_sigma_m))),
            range_sigma_m=self.range_sigma_m,
            paths=tuple(paths[i] for i in rng.permutation(len(paths))),
        )
