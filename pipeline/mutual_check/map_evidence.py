"""How likely each way to read a log is where the merged map has the robots: nothing is left to align."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.pipeline.mutual_check.readings import Apart
from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.config import AlignmentSettings, RadioModel
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Mixture, displacement
from wiclosure.wiclosure_filter.likelihood.observations import Observations, independence
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links


@dataclass(frozen=True, eq=False)
class LogEvidence:
    """How likely N logs are where a map has the robots, as natural logarithms; 0 is what says nothing.

    Args:
        total: `(N,)`.
        of_each: `(N, M)`, of each measurement; NaN for logs that have not as many as the first, or other headings.
    """

    total: FloatArray
    of_each: FloatArray


@dataclass(frozen=True, eq=False)
class MergedPair:
    """Two robots in one map.

    Args:
        pair: the robots.
        merged: their trajectories in the frame of the map.
        tied: keyframes of each at which closures hold the map; from there on odometry drifts.
        alignment: what is assumed of the radio.
    """

    pair: tuple[str, str]
    merged: Mapping[str, Trajectory]
    tied: Mapping[str, IntArray]
    alignment: AlignmentSettings

    def log_evidences(self, logs: Sequence[WirelessLog], widened: Sequence[bool]) -> FloatArray:
        """Log-likelihoods `(N,)` of logs where the map has the robots; 0 is a log that says nothing.

        Args:
            logs: of measurements of these two, the first as it was read, the others as it may be read.
            widened: true for logs of wider standard deviations: they count for no more than those of the first.
        """
        return self.evidence(logs, widened).total

    def evidence(self, logs: Sequence[WirelessLog], widened: Sequence[bool]) -> LogEvidence:
        """The same, of each measurement besides."""
        total, of_each = np.zeros(len(logs)), np.full((len(logs), len(logs[0].measurements)), np.nan)
        by_compass: dict[int, list[int]] = {}
        for n, log in enumerate(logs):
            by_compass.setdefault(id(log.headings), []).append(n)
        for same in by_compass.values():
            own = [logs[n] for n in same]
            total[same], part, row, each = self._of_same_headings(own, np.array([widened[n] for n in same]))
            if 0 in same:
                alike = np.array([len(log.measurements) == len(logs[0].measurements) for log in own])
                of_each[np.array(same)[alike]] = 0.0
                np.add.at(of_each, (np.array(same)[part[alike[part]]], row[alike[part]]), each[alike[part]])
        return LogEvidence(total, of_each)

    def apart(self, log: WirelessLog) -> Apart:
        """How far apart the antennas were, as measured and in the map."""
        return Apart.of(self._links(log), np.eye(4))

    def _links(self, log: WirelessLog) -> Links:
        return TeamLinks.of(self.merged, log, GatheringLimits.of(self.alignment)).by_pair[self.pair]

    def _of_same_headings(
        self, logs: Sequence[WirelessLog], widened: BoolArray
    ) -> tuple[FloatArray, IntArray, IntArray, FloatArray]:
        """Of all at once, as one log whose parts have nothing to do with each other.

        Returns:
            Log-evidences `(N,)`; of each measurement used: of which log it is, which of its measurements, and its own.
        """
        together = WirelessLog(tuple(m for log in logs for m in log.measurements), logs[0].headings)
        links = self._links(together)
        if len(links) == 0:
            nothing = np.zeros(0, np.int64)
            return np.zeros(len(logs)), nothing, nothing, np.zeros(0)
        starts = np.cumsum([0, *(len(log.measurements) for log in logs)])
        part = np.searchsorted(starts, links.measurement, side="right") - 1
        distance_m = np.linalg.norm(links.antenna_b - links.antenna_a, axis=1)
        observations = replace(
            Observations.of(links, self.alignment.radio),
            independence=independence(links, self.alignment.radio.static_radius_m, part),
            near_range_m=np.maximum(distance_m, MIN_DISTANCE_M),
        )
        each = self._of_measurements(observations, part, widened)
        total = np.bincount(part, each, len(logs)) + _compasses(observations, part, len(logs))
        return total, part, links.measurement - starts[part], each

    def _of_measurements(self, observations: Observations, part: IntArray, widened: BoolArray) -> FloatArray:
        """Log-likelihoods `(M,)`, weighed: neighbouring measurements share the drift of odometry.

        By as much as drift exceeds their noise each counts for less, ranges and bearings by their own.
        """
        position_m, yaw_rad = drift = self._drift(observations)
        as_merged = displacement(observations.state(np.eye(4))[None], observations, np.float64)
        there = np.stack(as_merged, axis=-1)
        across_rad = np.hypot(yaw_rad, position_m / observations.distance_m)
        no_paths, no_ranges = np.zeros_like(observations.weight), np.full(len(observations), np.nan)
        total = np.zeros(len(observations))
        for weight, range_m, off, noise in (
            (no_paths, observations.range_m, position_m, observations.range_sigma_m),
            (observations.weight, no_ranges, across_rad, _sharpest_rad(observations)),
        ):
            mixture = Mixture.of(observations.restricted(weight, range_m), self.alignment.radio, drift)
            told = 1.0 / (1.0 + (off / _as_first(noise, part, widened)) ** 2)
            total += observations.independence * told * mixture.explain(there).log_likelihood[0]
            if weight is no_paths:
                total += observations.independence * (1.0 - told) * self._of_changes(observations, part, there[0])
        return total

    def _of_changes(self, observations: Observations, part: IntArray, there: FloatArray) -> FloatArray:
        """Log-likelihoods `(M,)` of how ranges change from one measurement to the next of the same direction.

        What drift has spoilt since the closures is nearly the same for both, so it drops out, and so does an obstacle
        that stays; what is left is noise, as in von Neumann's ratio ("Distribution of the ratio of the mean square
        successive difference to the variance", 1941).  Each measurement is in two differences: they count half.
        """
        rows = np.flatnonzero(np.isfinite(observations.range_m))
        rows = rows[np.lexsort([observations.stamp_ns[rows], observations.a_receives[rows], part[rows]])]
        before, after = rows[:-1], rows[1:]
        same = (part[before] == part[after]) & (observations.a_receives[before] == observations.a_receives[after])
        before, after = before[same], after[same]
        excess_m = observations.range_m - np.linalg.norm(there, axis=1)
        a, b = (self.merged[robot] for robot in self.pair)
        odometry = PairOdometry(a, b, self.alignment.drift_inflation)
        drift_m, _ = odometry.drift_since(
            observations.index_a[before], observations.index_b[before], observations.subset(after)
        )
        noise = observations.range_sigma_m[before] ** 2 + observations.range_sigma_m[after] ** 2
        found = np.zeros(len(observations))
        found[after] = _sharpness(excess_m[after] - excess_m[before], noise, drift_m**2, self.alignment.radio) / 2
        return found

    def _drift(self, observations: Observations) -> tuple[FloatArray, FloatArray]:
        """Standard deviations `(M,)` of position (m) and yaw (rad) by odometry since the nearest closures."""
        at_a, at_b = (
            self.tied[robot][np.abs(self.tied[robot][:, None] - index).argmin(axis=0)]
            for robot, index in zip(self.pair, (observations.index_a, observations.index_b), strict=True)
        )
        a, b = (self.merged[robot] for robot in self.pair)
        odometry = PairOdometry(a, b, self.alignment.drift_inflation)
        return odometry.drift_since(at_a, at_b, observations)


def _sharpness(change_m: FloatArray, noise: FloatArray, drift: FloatArray, radio: RadioModel) -> FloatArray:
    """How changes of ranges' errors speak for noise and drift of these variances, all `(M,)`.

    Log-likelihoods by the mixture; 0 is a change that obstacles between the antennas explain as well.
    """
    both_direct, gross = (1.0 - radio.range_biased) ** 2, 1.0 - (1.0 - radio.range_outlier) ** 2

    def told(variance: FloatArray) -> FloatArray:
        peak = radio.range_reach_m / np.sqrt(2 * np.pi * variance)
        return np.asarray((1.0 - gross) * peak * np.exp(-(change_m**2) / (2 * variance)))

    obstructed = 2 * radio.range_bias_m**2 + drift
    as_noise = both_direct * told(noise + drift) + (1.0 - both_direct) * told(noise + obstructed)
    return np.asarray(np.log(gross + as_noise) - np.log(gross + told(obstructed)))


def _sharpest_rad(observations: Observations) -> FloatArray:
    """`(M,)` standard deviation of the most exact path; infinite without one."""
    return np.asarray(np.where(observations.weight > 0, observations.sigma, np.inf).min(axis=1))


def _as_first(noise: FloatArray, part: IntArray, widened: BoolArray) -> FloatArray:
    """Noise `(M,)` by which measurements count: of parts that are widened, that of the first part."""
    counted = np.nan_to_num(noise, nan=np.inf)
    for n in np.flatnonzero(widened):
        counted[part == n] = noise[part == 0]
    return counted


def _compasses(observations: Observations, part: IntArray, parts: int) -> FloatArray:
    """Log-densities `(N,)` of each part's headings where the map has the robots' frames."""
    found, as_merged = np.zeros(parts), observations.state(np.eye(4))[None]
    if np.isfinite(observations.yaw).any():
        for n in np.unique(part):
            own = observations.subset(np.flatnonzero(part == n))
            found[n] = Prior.of(own, use_headings=True, height_sigma_m=np.inf).log_density(as_merged)[0]
    return found
