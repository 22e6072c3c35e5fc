"""The log held against the merged map: once closures tell where the robots were, a systematic error shows by itself.

From a log alone a blunder is told by an alignment that it would make likelier.  In a merged map nothing is left to
align: each measurement has one distance and one direction that it should have, and a way to read the log is as likely
as it has them.  Ordinary errors, as large as calibration leaves them, are part of what an honest log may show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np
from scipy.special import logsumexp

from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.map_evidence import MergedPair
from wiclosure.pipeline.mutual_check.odds import in_words
from wiclosure.pipeline.mutual_check.partial_errors import PartialErrors
from wiclosure.pipeline.mutual_check.readings import Reading, readings_of_log
from wiclosure.types import Closure, FloatArray, IntArray, Stage, Trajectory, WirelessLog, survivors
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.faults.corrections import Correction
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks

_MOST = 100  # measurements of two robots: more would not decide otherwise
_FITS = float(np.log(100.0))  # by which a log that fits the map is likelier than one that says nothing
_NAMED = 2  # causes in a sentence, of those that are about as likely


def held_against_map(
    merged: Mapping[str, Trajectory],
    closures: Sequence[Closure],
    wireless: WirelessLog,
    alignment: AlignmentSettings,
    settings: MutualCheckSettings,
) -> AgainstMap:
    """What the merged map tells of the measurements between each two robots.

    Args:
        merged: keyframes of robots that closures connect, in the frame of their map.
        closures: of the run; accepted ones hold the map.
        wireless: the whole log, as it was read.
        alignment: what is assumed of the radio.
        settings: probabilities of errors, and when odds are decisive.
    """
    tied = _tied([c for c in survivors(closures, Stage.ESTIMATE) if c.query.robot in merged])
    contradicted: dict[tuple[str, str], Contradiction] = {}
    fitting: set[tuple[str, str]] = set()
    links = TeamLinks.of({robot: merged[robot] for robot in tied}, wireless, GatheringLimits.of(alignment))
    for (a, b), between in links.by_pair.items():
        rows = between.thinned(_MOST).measurement
        log = WirelessLog(
            tuple(wireless.measurements[row] for row in rows.tolist()),
            tuple(h for h in wireless.headings if h.robot in {a, b}),
        )
        pair = MergedPair((a, b), {r: merged[r] for r in (a, b)}, {r: tied[r] for r in (a, b)}, alignment)
        told = held_against(pair, log, settings) if len(rows) else None
        if isinstance(told, Contradiction):
            contradicted[a, b] = told
        elif told is Fit.GOOD:
            fitting.add((a, b))
    return AgainstMap(contradicted, frozenset(fitting))


class Fit(Enum):
    """How well a log that the map does not contradict fits it."""

    GOOD = auto()
    OPEN = auto()


@dataclass(frozen=True, slots=True)
class AgainstMap:
    """Logs of two robots each, held against a map.

    Args:
        contradicted: by the robots, measurements that the map speaks against.
        fitting: robots of whose measurements the map finds nothing wrong, and which it explains.
    """

    contradicted: Mapping[tuple[str, str], Contradiction] = field(default_factory=dict)
    fitting: frozenset[tuple[str, str]] = frozenset()

    def __or__(self, other: AgainstMap) -> AgainstMap:
        """Of robots of several maps."""
        return AgainstMap({**self.contradicted, **other.contradicted}, self.fitting | other.fitting)


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


def held_against(pair: MergedPair, log: WirelessLog, settings: MutualCheckSettings) -> Contradiction | Fit:
    """How the map speaks for or against the log of the two robots: either way from the same odds on."""
    told = MapOdds.of(pair, log, settings)
    decisive = np.log(settings.decisive_odds)
    if told.log_odds < decisive:
        return Fit.GOOD if told.log_odds < -decisive and told.as_read > _FITS else Fit.OPEN
    likely = sorted(told.causes, key=lambda cause: -cause.log_probability)[:_NAMED]
    if likely[0].explained < _FITS:
        return Contradiction(told.log_odds)
    least = likely[0].log_probability - decisive
    return Contradiction(told.log_odds, tuple(cause.undone for cause in likely if cause.log_probability > least))


@dataclass(frozen=True, slots=True)
class _Cause:
    """An error: how likely it is with what it explains, how much that is, and what undoes it by its likeliest size."""

    log_probability: float
    explained: float
    undone: Correction


@dataclass(frozen=True, eq=False)
class MapOdds:
    """What is weighed of a log where the map has the robots; natural logarithms.

    Args:
        as_read: log-evidence of the log as it claims to be.
        tried: errors.
        found: log-evidence with each size of each error undone.
        wrong: log-probability of each error, with what it explains.
        partial: errors that only a part of the log has, as seldom as two at once.
        partly_wrong: log-probability of any of these.
        log_odds: that something is wrong with the log, known or not, against ordinary errors.
    """

    as_read: float
    tried: Sequence[Reading]
    found: Sequence[FloatArray]
    wrong: FloatArray
    partial: PartialErrors
    partly_wrong: float
    log_odds: float

    @classmethod
    def of(cls, pair: MergedPair, log: WirelessLog, settings: MutualCheckSettings) -> MapOdds:
        """Every way to read the log of the two robots, against the log as it was read."""
        tried = readings_of_log(*pair.pair, log, pair.alignment.calibration, pair.apart(log))
        widened = [False, *(reading.widens for reading in tried for _ in reading.corrections)]
        others = [c.apply((pair.merged, log))[1] for reading in tried for c in reading.corrections]
        evidence = pair.evidence([log, *others], widened)
        as_read, *each = evidence.total.tolist()
        found = np.split(np.array(each), np.cumsum([len(reading.corrections) for reading in tried])[:-1])
        usual = [float(np.max(of - np.square(r.sigmas) / 2)) for r, of in zip(tried, found, strict=True) if r.sigmas]
        honest = np.log(1.0 - settings.systematic_error - settings.unknown_error) + max(as_read, *usual, -np.inf)
        known = np.log(settings.systematic_error / len(tried))
        wrong = known + np.array([logsumexp(of + r.log_shares) for r, of in zip(tried, found, strict=True)])
        partial = PartialErrors.of(log, tried, evidence)
        partly_wrong = float(2 * known + logsumexp([-np.inf, *partial.log_evidence.ravel()]))
        log_odds = float(logsumexp([*wrong, partly_wrong, np.log(settings.unknown_error)]) - honest)
        return cls(as_read, tried, found, wrong, partial, partly_wrong, log_odds)

    @property
    def causes(self) -> list[_Cause]:
        """Each error that may be at fault, and the likeliest of those of a part."""
        whole = [
            _Cause(float(wrong), float(found.max()), _likeliest(reading, found))
            for reading, found, wrong in zip(self.tried, self.found, self.wrong, strict=True)
        ]
        of_part = self.partial.likeliest(1)
        return [*whole, *(_Cause(self.partly_wrong, one.log_evidence, one.undone) for one in of_part)]


def _likeliest(reading: Reading, found: FloatArray) -> Correction:
    """Of its sizes."""
    return reading.corrections[int(np.argmax(found + reading.log_shares))]


def _tied(closures: Sequence[Closure]) -> dict[str, IntArray]:
    """Keyframes of each robot that closures with others hold."""
    tied: dict[str, set[int]] = {}
    for closure in closures:
        if closure.query.robot != closure.match.robot:
            for key in (closure.query, closure.match):
                tied.setdefault(key.robot, set()).add(key.index)
    return {robot: np.array(sorted(indices), np.int64) for robot, indices in tied.items()}
