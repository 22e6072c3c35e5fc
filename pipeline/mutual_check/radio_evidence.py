"""How likely a log is under the alignment that closures imply, and under one of its own, for every way to read it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from wiclosure import se3
from wiclosure.pipeline.mutual_check.map_evidence import MergedPair
from wiclosure.pipeline.mutual_check.partial_errors import PartialErrors
from wiclosure.pipeline.mutual_check.readings import Apart, Reading, readings
from wiclosure.types import Closure, FloatArray, Trajectory, WirelessLog, measured_poses
from wiclosure.wiclosure_filter.alignment.radio_check import RadioConsistencyCheck
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.consensus.consensus import consensus
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem
from wiclosure.wiclosure_filter.faults.corrections import Correction, RadioInputs
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

_COMPATIBLE = float(np.log(100.0))  # an alignment that the log itself thinks no worse than this
_MOST = 100  # measurements: more would not decide otherwise, and each reading takes as much longer
_PROPOSALS = 1500  # a log that tells an alignment needs no longer search
_PEAKS = 4  # of the likelihood that an alignment of closures is held against
_FIRST = 3  # errors, those that leave least unexplained, beside which a second one is tried


@dataclass(frozen=True, slots=True)
class Explained:
    """How well one way to read the log explains what was measured; log-evidence 0 is a log that says nothing.

    Args:
        fault: what is wrong with the log, by the likeliest size of the error; empty for the log as it claims to be.
        implied: under the alignment that closures imply, over all sizes as they were likely beforehand.
        free: under the likeliest alignment of all; minus infinity where none was searched for.
        chosen: logarithm of how many alignments as exact there were to choose that one from.
        undone: what undoes the error at that size; None for the log as it claims to be.
        log_share: how likely that size was beforehand, as a natural logarithm.
    """

    fault: str
    implied: float
    free: float = -np.inf
    chosen: float = 0.0
    undone: Correction | None = field(default=None, repr=False)
    log_share: float = 0.0

    @property
    def contradicts(self) -> bool:
        """Whether the log by itself tells another alignment than the closures."""
        return self.free - self.implied > _COMPATIBLE

    @property
    def log_evidence(self) -> float:
        """Of the log under an alignment of its own, over all alignments that it might have chosen (Laplace)."""
        return self.free - self.chosen


@dataclass(frozen=True, eq=False)
class PairRadio:
    """What two robots measured of each other, to be held against closures.

    Args:
        pair: the robots.
        trajectories: keyframe odometry of both.
        log: their measurements, and their headings.
        settings: what is assumed of the radio.
    """

    pair: tuple[str, str]
    trajectories: Mapping[str, Trajectory]
    log: WirelessLog
    settings: AlignmentSettings

    @classmethod
    def of(
        cls,
        pair: tuple[str, str],
        trajectories: Mapping[str, Trajectory],
        wireless: WirelessLog,
        settings: AlignmentSettings,
    ) -> PairRadio:
        """The part of a log that two robots made."""
        own = tuple(m for m in wireless.measurements if {m.receiver, m.transmitter} == set(pair))
        headings = tuple(h for h in wireless.headings if h.robot in pair)
        return cls(pair, {robot: trajectories[robot] for robot in pair}, WirelessLog(own, headings), settings)

    @cached_property
    def measurements(self) -> int:
        """How many of the log can be used."""
        return len(self._links(self.trajectories, self.log))

    def claimed(self, closures: Sequence[Closure]) -> Explained:
        """The log as it claims to be."""
        return Explained("", *self._evidence((self.trajectories, self.log), closures, search=True))

    def errors(self, closures: Sequence[Closure], *, search: bool = True) -> list[Explained]:
        """Every systematic error that the log may have, undone; see `Reading` for what is searched."""
        tried = readings(*self.pair, self.log, apart=self._apart(closures))
        return [self._explained(reading, closures, search=search) for reading in tried]

    def second_errors(self, closures: Sequence[Closure], errors: Sequence[Explained]) -> list[Explained]:
        """The log with two errors undone where closures have the robots: one of the likeliest of `errors`, and any."""
        first = sorted(errors, key=lambda one: one.implied, reverse=True)[:_FIRST]
        return [two for one in first if one.undone is not None for two in self._besides(one, one.undone, closures)]

    def _besides(self, one: Explained, undone: Correction, closures: Sequence[Closure]) -> list[Explained]:
        trajectories, log = undone.apply((self.trajectories, self.log))
        left = replace(self, trajectories=trajectories, log=log)
        if left.measurements == 0:
            return []
        return [
            replace(other, fault=f"{one.fault}; and {other.fault}", implied=one.log_share + other.implied, undone=None)
            for other in left.errors(closures, search=False)
        ]

    def partial_errors(self, closures: Sequence[Closure]) -> list[Explained]:
        """The log with the likeliest errors undone that only a part of it has, where closures have the robots."""
        first, second = self.pair
        middle, T_a_b = self._implied(closures)
        there = {first: self.trajectories[first], second: self.trajectories[second].moved(T_a_b)}
        tied = {key.robot: np.array([key.index]) for key in (middle.query, middle.match)}
        errors = readings(*self.pair, self.log, apart=self._apart(closures))
        of_log = [reading for reading in errors if all(c.of_log for c in reading.corrections)]
        found = PartialErrors.among(MergedPair(self.pair, there, tied, self.settings), self.log, of_log)
        return [
            Explained(one.undone.fault, one.log_share + self._with_undone(one.undone, closures))
            for one in found.likeliest(_FIRST)
        ]

    def _with_undone(self, correction: Correction, closures: Sequence[Closure]) -> float:
        """Log-evidence of the log where closures have the robots."""
        return self._evidence(correction.apply((self.trajectories, self.log)), closures, search=False)[0]

    def _apart(self, closures: Sequence[Closure]) -> Apart:
        return Apart.of(self._links(self.trajectories, self.log), self._implied(closures)[1])

    def _implied(self, closures: Sequence[Closure]) -> tuple[Closure, FloatArray]:
        """The closure that stands for the others, and the alignment `T_a_b (4, 4)` of the frames that it implies."""
        middle = central(closures, self.trajectories)
        T_query_match = measured_poses([middle])[0][0]
        at_a, at_b = (self.trajectories[key.robot].poses[key.index] for key in (middle.query, middle.match))
        return middle, at_a @ T_query_match @ se3.inverse(at_b)

    def _explained(self, reading: Reading, closures: Sequence[Closure], *, search: bool) -> Explained:
        inputs = [correction.apply((self.trajectories, self.log)) for correction in reading.corrections]
        searched = search and reading.changes_alignment
        implied, free, chosen = np.array([self._evidence(given, closures, search=searched) for given in inputs]).T
        shares = reading.log_shares
        best = int(np.argmax(np.maximum(implied, free) + shares))
        return Explained(
            reading.corrections[best].fault,
            float(logsumexp(implied + shares)),
            float(free[best]),
            float(chosen[best] - shares[best]),
            reading.corrections[best],
            float(shares[best]),
        )

    def _evidence(
        self, inputs: RadioInputs, closures: Sequence[Closure], *, search: bool
    ) -> tuple[float, float, float]:
        """Log-evidence of a log: implied, and free or minus infinity with what it was chosen from."""
        trajectories, log = inputs
        links = self._links(trajectories, log)
        if len(links) == 0:
            return 0.0, -np.inf, 0.0
        problem = AlignmentProblem.of(links, trajectories, self.settings)
        # As in the radio consistency check: that robots are level is nothing to hold against a measured pose.
        problem = replace(problem, prior=replace(problem.prior, height_sigma_m=self.settings.height_sigma_m))
        peaks = consensus(problem, min(self.settings.proposals, _PROPOSALS)) if search else None
        likely = np.zeros((0, 4)) if peaks is None else peaks.peaks.states[:_PEAKS]
        T_a_b, covariance = measured_poses(closures)
        index_a, index_b = np.array([(c.query.index, c.match.index) for c in closures]).T
        check = RadioConsistencyCheck(likely, problem, 2.0)
        free, implied = check.log_posteriors(T_a_b, covariance, index_a, index_b)
        best = int(np.argmax(implied))
        chosen = 0.0 if peaks is None else _chosen(peaks.peaks.information[0], self.settings.radio.range_reach_m)
        return float(implied[best]), float(free[best]), chosen

    def _links(self, trajectories: Mapping[str, Trajectory], log: WirelessLog) -> Links:
        limits = GatheringLimits.of(self.settings)
        links = TeamLinks.of(trajectories, log, limits).by_pair[self.pair]
        return links.thinned(min(self.settings.max_measurements, _MOST))


def _chosen(information: FloatArray, reach_m: float) -> float:
    """Logarithm of the volume of level alignments within reach, by that of one as exact as its `information (4, 4)`."""
    spread = np.linalg.pinv(information)[:3, :3]  # yaw, x, y; the height has a prior of its own
    one = 1.5 * np.log(2 * np.pi) + 0.5 * np.linalg.slogdet(spread)[1]
    return max(float(np.log(2 * np.pi * np.pi * reach_m**2) - one), 0.0)


def central(closures: Sequence[Closure], trajectories: Mapping[str, Trajectory]) -> Closure:
    """The closure whose alignment of the frames lies nearest to those of the others of a set."""
    a, b = closures[0].query.robot, closures[0].match.robot
    T_a_b, _ = measured_poses(closures)
    at_a = trajectories[a].poses[[c.query.index for c in closures]]
    at_b = trajectories[b].poses[[c.match.index for c in closures]]
    middle = trajectories[b].positions.mean(axis=0)
    there: FloatArray = at_a @ T_a_b @ se3.inverse(at_b) @ np.append(middle, 1.0)
    return closures[int(np.argmin(np.linalg.norm(there - np.median(there, axis=0), axis=1)))]
