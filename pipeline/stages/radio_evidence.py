"""How likely a log is under the alignment that closures imply, and under one of its own, for every way to read it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from wiclosure import se3
from wiclosure.pipeline.stages.radio_readings import AS_CLAIMED, FAULTS, OTHERWISE_READ, Reading
from wiclosure.types import Closure, FloatArray, Trajectory, WirelessLog, measured_poses
from wiclosure.wiclosure_filter.alignment.consensus import consensus
from wiclosure.wiclosure_filter.alignment.problem import AlignmentProblem
from wiclosure.wiclosure_filter.alignment.radio_check import RadioConsistencyCheck
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

_MOST = 200  # measurements: more would not decide otherwise, and each reading takes as much longer
_PEAKS = 4  # of the likelihood that an alignment of closures is held against


@dataclass(frozen=True, eq=False)
class Explained:
    """A way to read the log, and the log-evidence of what was measured; 0 is a log that says nothing.

    Args:
        reading: the error.
        cause: what is wrong, by the likeliest of its corrections.
        implied: under the alignment that closures imply, all corrections being equally likely beforehand.
        free: under the likeliest alignment of all; minus infinity where none was searched for.
    """

    reading: Reading
    cause: str
    implied: float
    free: float


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
        return len(self._links(self.log))

    def claimed(self, closures: Sequence[Closure]) -> Explained:
        """The log as it claims to be."""
        return Explained(AS_CLAIMED, AS_CLAIMED.causes[0], *self._evidence(self.log, closures, search=True))

    def errors(self, closures: Sequence[Closure], *, search: bool = True) -> list[Explained]:
        """Every systematic error that the log can have, undone; an alignment is searched for those of few sizes."""
        found = (self._explained(r, closures, search=search and r in OTHERWISE_READ) for r in FAULTS)
        return [explained for explained in found if explained is not None]

    def _explained(self, reading: Reading, closures: Sequence[Closure], *, search: bool) -> Explained | None:
        """None where no correction changes the log."""
        found = []
        for cause, correction in zip(reading.causes, reading.corrections, strict=True):
            log = correction(self.log)
            if log != self.log:
                found.append((cause, *self._evidence(log, closures, search=search)))
        if not found:
            return None
        causes, implied, free = zip(*found, strict=True)
        best = int(np.argmax(implied if max(implied) > max(free) - 1.0 else free))
        count = np.log(len(found))
        return Explained(reading, causes[best], float(logsumexp(implied) - count), float(logsumexp(free) - count))

    def _evidence(self, log: WirelessLog, closures: Sequence[Closure], *, search: bool) -> tuple[float, float]:
        """Log-evidence of a log: implied, and free or minus infinity."""
        links = self._links(log)
        if len(links) == 0:
            return 0.0, -np.inf
        problem = AlignmentProblem.of(links, self.trajectories, self.settings)
        # As in the radio consistency check: that robots are level is nothing to hold against a measured pose.
        problem = replace(problem, prior=replace(problem.prior, height_sigma_m=self.settings.height_sigma_m))
        peaks = consensus(problem, self.settings.proposals) if search else None
        likely = np.zeros((0, 4)) if peaks is None else peaks.peaks.states[:_PEAKS]
        T_a_b, covariance = measured_poses(closures)
        index_a, index_b = np.array([(c.query.index, c.match.index) for c in closures]).T
        check = RadioConsistencyCheck(likely, problem, 2.0)
        free, implied = check.log_posteriors(T_a_b, covariance, index_a, index_b)
        best = int(np.argmax(implied))
        return float(implied[best]), float(free[best])

    def _links(self, log: WirelessLog) -> Links:
        limits = GatheringLimits.of(self.settings)
        links = TeamLinks.of(self.trajectories, log, limits).by_pair[self.pair]
        return links.thinned(min(self.settings.max_measurements, _MOST))


def central(closures: Sequence[Closure], trajectories: Mapping[str, Trajectory]) -> Closure:
    """The closure whose alignment of the frames lies nearest to those of the others of a set."""
    a, b = closures[0].query.robot, closures[0].match.robot
    T_a_b, _ = measured_poses(closures)
    at_a = trajectories[a].poses[[c.query.index for c in closures]]
    at_b = trajectories[b].poses[[c.match.index for c in closures]]
    middle = trajectories[b].positions.mean(axis=0)
    there: FloatArray = at_a @ T_a_b @ se3.inverse(at_b) @ np.append(middle, 1.0)
    return closures[int(np.argmin(np.linalg.norm(there - np.median(there, axis=0), axis=1)))]
