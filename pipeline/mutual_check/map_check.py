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
from wiclosure.pipeline.mutual_check.readings import Apart, Reading, readings_of_log
from wiclosure.types import Closure, FloatArray, IntArray, Stage, Trajectory, WirelessLog, survivors
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.faults.corrections import Correction
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
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

    def log_evidence(self, log: WirelessLog, weighed: WirelessLog | None = None) -> float:
        """Log-likelihood of a log where the map has the robots; 0 is a log that says nothing.

        Args:
            log: measurements of these two.
            weighed: the same ones with the noise by which they count; None: as they state it.
        """
        observations = self._observations(log)
        if observations is None:
            return 0.0
        # Drift is shared by neighbouring measurements: by as much as it exceeds their noise, each counts for less.
        stated = observations if weighed is None else self._observations(weighed) or observations
        position_m, _ = drift = self._drift(observations)
        counted = observations.independence / (1.0 + (position_m / _noise_m(stated)) ** 2)
        mixture = Mixture.of(replace(observations, independence=counted), self.alignment.radio, drift)
        compass = Prior.of(observations, use_headings=True, height_sigma_m=np.inf)
        as_merged = observations.state(np.eye(4))[None]
        return float(mixture.log_likelihood(as_merged)[0] + compass.log_density(as_merged)[0])

    def apart(self, log: WirelessLog) -> Apart:
        """How far apart the antennas were, as measured and in the map."""
        return Apart.of(self._links(log), np.eye(4))

    def _links(self, log: WirelessLog) -> Links:
        return TeamLinks.of(self.merged, log, GatheringLimits.of(self.alignment)).by_pair[self.pair]

    def _observations(self, log: WirelessLog) -> Observations | None:
        links = self._links(log)
        return Observations.of(links, self.alignment.radio) if len(links) else None

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
    as_read = pair.log_evidence(log)
    tried = readings_of_log(*pair.pair, log, pair.alignment.calibration, pair.apart(log))
    each = [
        np.array([pair.log_evidence(c.apply((pair.merged, log))[1], log if r.widens else None) for c in r.corrections])
        for r in tried
    ]
    usual = [float(np.max(found - np.square(r.sigmas) / 2)) for r, found in zip(tried, each, strict=True) if r.sigmas]
    honest = np.log(1.0 - settings.systematic_error - settings.unknown_error) + max(as_read, *usual, -np.inf)
    known = np.log(settings.systematic_error / len(tried))
    wrong = [float(known + logsumexp(found) - r.log_sizes) for r, found in zip(tried, each, strict=True)]
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


def _noise_m(observations: Observations) -> FloatArray:
    """`(M,)` m, how exact each measurement is: its range, or its most exact path across the distance."""
    along = np.where(np.isfinite(observations.range_m), observations.range_sigma_m, np.inf)
    across = np.where(observations.weight > 0, observations.sigma, np.inf).min(axis=1)
    return np.asarray(np.minimum(along, across * np.maximum(observations.distance_m, MIN_DISTANCE_M)))


def _tied(closures: Sequence[Closure]) -> dict[str, IntArray]:
    """Keyframes of each robot that closures with others hold."""
    tied: dict[str, set[int]] = {}
    for closure in closures:
        if closure.query.robot != closure.match.robot:
            for key in (closure.query, closure.match):
                tied.setdefault(key.robot, set()).add(key.index)
    return {robot: np.array(sorted(indices), np.int64) for robot, indices in tied.items()}
