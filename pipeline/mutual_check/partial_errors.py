"""Errors that only a part of a log has: what one robot received, or all that was measured before or after a time.

A change may lie between any two measurements.  All places and all errors are weighed at once where closures have the
robots: of each measurement it is known what each error, undone, would explain of it, and parts are sums of that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.pipeline.mutual_check.map_evidence import LogEvidence, MergedPair
from wiclosure.pipeline.mutual_check.readings import Reading
from wiclosure.types import FloatArray, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.faults.corrections import Correction, RadioInputs


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a log.

    Args:
        clause: which, for the user.
        receiver: the robot that received it; empty for either.
        since_ns: its first stamp; None: from the start on.
        until_ns: the first stamp after it; None: to the end.
    """

    clause: str
    receiver: str = ""
    since_ns: int | None = None
    until_ns: int | None = None

    def holds(self, m: WirelessMeasurement) -> bool:
        """Whether a measurement belongs to it."""
        after = self.since_ns is None or m.stamp_ns >= self.since_ns
        before = self.until_ns is None or m.stamp_ns < self.until_ns
        return after and before and self.receiver in {"", m.receiver}

    def corrected(self, whole: Correction) -> Correction:
        """What undoes an error in this part only."""

        def apply(inputs: RadioInputs) -> RadioInputs:
            trajectories, log = inputs
            alone = (
                replace(log, measurements=(m,)) for m in log.measurements
            )  # one by one: an error may leave some out
            changed = (whole.apply((trajectories, m))[1] if self.holds(m.measurements[0]) else m for m in alone)
            return trajectories, replace(log, measurements=tuple(m for one in changed for m in one.measurements))

        return replace(whole, fault=f"{self.clause}, {whole.fault}", apply=apply, whole_log=False)


@dataclass(frozen=True, slots=True)
class PartialError:
    """One error of one part: what undoes it, how likely it was beforehand, and with that the log's evidence for it."""

    undone: Correction
    log_share: float
    log_evidence: float


@dataclass(frozen=True, eq=False)
class PartialErrors:
    """Every error in every part of a log.

    Args:
        parts: P of them.
        corrections: N, of all sizes of all errors.
        log_shares: `(N,)`, how likely each size of an error was beforehand, and one part of all.
        log_evidence: `(N, P)`, of the whole log with each undone in each part, and with that; natural logarithms.
    """

    parts: Sequence[Part]
    corrections: Sequence[Correction]
    log_shares: FloatArray
    log_evidence: FloatArray

    @classmethod
    def of(cls, log: WirelessLog, tried: Sequence[Reading], found: LogEvidence) -> PartialErrors:
        """Of the log of two robots.

        Args:
            log: as it was read.
            tried: errors, of which those that leave out measurements, or widen standard deviations, are none of a part.
            found: of the log as it was read, and with each size of each error undone.
        """
        parts = _parts(log)
        if not parts:
            return cls((), (), np.zeros(0), np.zeros((0, 0)))
        gained = found.of_each[1:] - found.of_each[0]
        widens = np.array([reading.widens for reading in tried for _ in reading.corrections])
        rows = np.flatnonzero(np.isfinite(gained).all(axis=1) & gained.any(axis=1) & ~widens)
        inside = np.array([[part.holds(m) for m in log.measurements] for part in parts], float)
        log_shares = np.concatenate([reading.log_shares for reading in tried])[rows] - np.log(len(parts))
        log_evidence = gained[rows] @ inside.T + (found.total[0] + log_shares)[:, None]
        corrections = [correction for reading in tried for correction in reading.corrections]
        return cls(parts, [corrections[row] for row in rows.tolist()], log_shares, log_evidence)

    @classmethod
    def among(cls, pair: MergedPair, log: WirelessLog, tried: Sequence[Reading]) -> PartialErrors:
        """The same, where a map has the robots; `tried` are errors of the log alone."""
        others = [correction.apply((pair.merged, log))[1] for reading in tried for correction in reading.corrections]
        return cls.of(log, tried, pair.evidence([log, *others], [False] * (1 + len(others))))

    def likeliest(self, most: int) -> list[PartialError]:
        """So many of them."""
        order = np.argsort(self.log_evidence, axis=None)[::-1][:most]
        rows, columns = np.unravel_index(order, self.log_evidence.shape)
        return [
            PartialError(
                self.parts[part].corrected(self.corrections[n]),
                float(self.log_shares[n]),
                float(self.log_evidence[n, part]),
            )
            for n, part in zip(rows.tolist(), columns.tolist(), strict=True)
        ]


def _parts(log: WirelessLog) -> list[Part]:
    """What each robot received, if both did, and what lies before or after each change there may have been."""
    receivers = sorted({m.receiver for m in log.measurements})
    found = [Part(f"in what {robot} received", receiver=robot) for robot in receivers if len(receivers) > 1]
    stamps = sorted({m.stamp_ns for m in log.measurements})
    for stamp_ns in stamps[1:]:
        seconds = f"{(stamp_ns - stamps[0]) / 1e9:.0f} s after the first measurement"
        found.append(Part(f"from {seconds} on", since_ns=stamp_ns))
        found.append(Part(f"until {seconds}", until_ns=stamp_ns))
    return found
