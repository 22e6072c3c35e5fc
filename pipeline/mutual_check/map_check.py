"""The log held against the merged map: once closures tell where the robots were, a systematic error shows by itself.

From a log alone a blunder is told by an alignment that it would make likelier.  In a merged map nothing is left to
align: each measurement has one distance and one direction that it should have, and a way to read the log is as likely
as it has them.  Ordinary errors, as large as calibration leaves them, are part of what an honest log may show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.odds import in_words
from wiclosure.pipeline.mutual_check.readings import Reading, readings_of_log
from wiclosure.types import BoolArray, Closure, FloatArray, IntArray, Stage, Trajectory, WirelessLog, survivors
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.faults.corrections import Correction
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Mixture, displacement
from wiclosure.wiclosure_filter.likelihood.observations import Observations, independence
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

_MOST = 100  # measurements of two robots: more would not decide otherwise
_FITS = float(np.log(100.0))  # by which a log that fits the map is likelier than one that says nothing
_NAMED = 2  # causes in a sentence, of those that are about as likely


def held_against_map(
    merged: Mapping[str, Trajectory],
    closures: Sequence[Closure],
    wireless: WirelessLog,
    alignment: AlignmentSettings,
    settings: MutualCheckSettings,
) -> dict[tuple[str, str], Contradiction]:
    """What the merged map tells of the measurements between each two robots that contradict it.

    Args:
        merged: keyframes of robots that closures connect, in the frame of their map.
        closures: of the run; accepted ones hold the map.
        wireless: the whole log, as it was read.
        alignment: what is assumed of the radio.
        settings: probabilities of errors, and when odds are decisive.
    """
    tied = _tied([c for c in survivors(closures, Stage.ESTIMATE) if c.query.robot in merged])
    said: dict[tuple[str, str], Contradiction] = {}
    links = TeamLinks.of({robot: merged[robot] for robot in tied}, wireless, GatheringLimits.of(alignment))
    for (a, b), between in links.by_pair.items():
        rows = between.thinned(_MOST).measurement
        log = WirelessLog(
            tuple(wireless.measurements[row] for row in rows.tolist()),
            tuple(h for h in wireless.headings if h.robot in {a, b}),
        )
        pair = MergedPair((a, b), {r: merged[r] for r in (a, b)}, {r: tied[r] for r in (a, b)}, alignment)
        if len(rows) and (told := contradiction(pair, log, settings)):
            said[a, b] = told
    return said


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A log that the map speaks against.

    Args:
        log_odds: natural logarithm of the odds that something is wrong.
        causes: what is likely wrong with the log, and would undo it; empty where no known error explains it.
    """

    log_odds: float
    causes: tuple[Correction, ...] = ()

    @property
    def odds(self) -> str:
        """That something is wrong."""
        return in_words(self.log_odds)

    @property
    def likely(self) -> str:
        """The causes, likeliest first."""
        return ", or ".join(cause.fault for cause in self.causes)

    def __str__(self) -> str:
        if self.causes:
            return f"by where the merged map has the robots, the radio is the likely fault ({self.odds}): {self.likely}"
        return (
            f"radio and merged map contradict each other ({self.odds}), and no known error of a log explains it: the"
            " radio may be at fault, or closures of places that look alike"
        )


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
        found = np.zeros(len(logs))
        by_compass: dict[int, list[int]] = {}
        for n, log in enumerate(logs):
            by_compass.setdefault(id(log.headings), []).append(n)
        for same in by_compass.values():
            found[same] = self._of_same_headings([logs[n] for n in same], np.array([widened[n] for n in same]))
        return found

    def _of_same_headings(self, logs: Sequence[WirelessLog], widened: BoolArray) -> FloatArray:
        """The same, all at once: as one log whose parts have nothing to do with each other."""
        together = WirelessLog(tuple(m for log in logs for m in log.measurements), logs[0].headings)
        links: Links = TeamLinks.of(self.merged, together, GatheringLimits.of(self.alignment)).by_pair[self.pair]
        if len(links) == 0:
            return np.zeros(len(logs))
        starts = np.cumsum([0, *(len(log.measurements) for log in logs)])
        part = np.searchsorted(starts, links.measurement, side="right") - 1
        distance_m = np.linalg.norm(links.antenna_b - links.antenna_a, axis=1)
        observations = replace(
            Observations.of(links, self.alignment.radio),
            independence=independence(links, self.alignment.radio.static_radius_m, part),
            near_range_m=np.maximum(distance_m, MIN_DISTANCE_M),
        )
        each = self._of_measurements(observations, part, widened)
        return np.bincount(part, each, len(logs)) + _compasses(observations, part, len(logs))

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
            counted = observations.independence / (1.0 + (off / _as_first(noise, part, widened)) ** 2)
            total += counted * mixture.explain(there).log_likelihood[0]
        return total

    def _drift(self, observations: Observations) -> tuple[FloatArray, FloatArray]:
        """Standard deviations `(M,)` of position (m) and yaw (rad) by odometry since the nearest closures."""
        at_a, at_b = (
            self.tied[robot][np.abs(self.tied[robot][:, None] - index).argmin(axis=0)]
            for robot, index in zip(self.pair, (observations.index_a, observations.index_b), strict=True)
        )
        a, b = (self.merged[robot] for robot in self.pair)
        odometry = PairOdometry(a, b, self.alignment.drift_inflation)
        return odometry.drift_since(at_a, at_b, observations)


def contradiction(pair: MergedPair, log: WirelessLog, settings: MutualCheckSettings) -> Contradiction | None:
    """How the map speaks against the log of two robots; None where it does not."""
    tried = readings_of_log(*pair.pair, log, pair.alignment.calibration)
    widened = [False, *(reading.widens for reading in tried for _ in reading.corrections)]
    others = [c.apply((pair.merged, log))[1] for reading in tried for c in reading.corrections]
    as_read, *found = pair.log_evidences([log, *others], widened).tolist()
    each = np.split(np.array(found), np.cumsum([len(reading.corrections) for reading in tried])[:-1])
    usual = [float(np.max(of - np.square(r.sigmas) / 2)) for r, of in zip(tried, each, strict=True) if r.sigmas]
    honest = np.log(1.0 - settings.systematic_error - settings.unknown_error) + max(as_read, *usual, -np.inf)
    known = np.log(settings.systematic_error / len(tried))
    wrong = [float(known + logsumexp(of) - np.log(len(of))) for of in each]
    log_odds = float(logsumexp([*wrong, np.log(settings.unknown_error)]) - honest)
    if log_odds < np.log(settings.decisive_odds):
        return None
    order = np.argsort(wrong)[::-1]
    if each[order[0]].max() < _FITS:
        return Contradiction(log_odds)
    likely = [n for n in order[:_NAMED] if wrong[n] > wrong[order[0]] - np.log(settings.decisive_odds)]
    return Contradiction(log_odds, tuple(_likeliest(tried[n], each[n]) for n in likely))


def _likeliest(reading: Reading, found: FloatArray) -> Correction:
    """Of its sizes."""
    return reading.corrections[int(np.argmax(found))]


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


def _tied(closures: Sequence[Closure]) -> dict[str, IntArray]:
    """Keyframes of each robot that closures with others hold."""
    tied: dict[str, set[int]] = {}
    for closure in closures:
        if closure.query.robot != closure.match.robot:
            for key in (closure.query, closure.match):
                tied.setdefault(key.robot, set()).add(key.index)
    return {robot: np.array(sorted(indices), np.int64) for robot, indices in tied.items()}
