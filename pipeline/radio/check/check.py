"""All checks of a radio log against trajectories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.radio.radio_units import LengthUnit
from wiclosure.pipeline.radio.check.absolute import absolute
from wiclosure.pipeline.radio.check.bearings import check_bearings
from wiclosure.pipeline.radio.check.clock import Span, check_clock, check_overlap, common_span
from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.check.geometry import PairSamples, pair_samples
from wiclosure.pipeline.radio.check.ranges import check_ranges
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.types import Trajectory, WirelessLog

_GAP_S, _GAP_INTERVALS = 5.0, 20.0
_HELD = 0.3  # of the ranges: a driver that repeats its last value while nothing is heard


@dataclass(frozen=True, slots=True)
class CheckResult:
    """What a check found, in the order of the checks."""

    findings: tuple[Finding, ...]

    @property
    def settings(self) -> Mapping[str, object]:
        """Keys that at least one suspicion would add, where the pairs agree on the value."""
        values: dict[str, list[object]] = {}
        for finding in self.findings:
            if finding.level == "suspect":
                for key, value in finding.settings.items():
                    values.setdefault(key, []).append(value)
        return {key: found[0] for key, found in values.items() if _agree(found)}


def check_log(
    log: WirelessLog, trajectories: Mapping[str, Trajectory], source: RadioSource | None = None
) -> CheckResult:
    """Holds a log against the robots' trajectories: overlap, gaps, repeated values, units, clock, bearings.

    Args:
        log: measurements by the robots' names.
        trajectories: odometry (or truth) of each robot, each in a frame of its own.
        source: how the log was read; corrections are keys to state in it, in the place of those it has.

    Raises:
        InputError: the log is empty, or no pair in it has both trajectories.
    """
    if not log.measurements:
        raise InputError("the log holds no measurements; nothing can be checked")
    stamps = [m.stamp_ns for m in log.measurements]
    known = [m for m in log.measurements if {m.receiver, m.transmitter} <= trajectories.keys()]
    if not known:
        raise InputError(
            f"the log is of {', '.join(sorted(log.robots()))}, the trajectories of {', '.join(trajectories)}:"
            " no pair has both; map the ids with robots"
        )
    source = source or RadioSource(topic="/any")
    read = "s" if source.stamp_unit == "auto" else source.stamp_unit  # of dates, auto finds the unit
    apart = check_overlap(Span(min(stamps), max(stamps)), common_span(trajectories), read)
    if apart is not None:
        return CheckResult(tuple(absolute([apart], source)))
    findings = [_left_aside(len(log.measurements) - len(known))] if len(known) < len(log.measurements) else []
    for samples in pair_samples(known).values():
        findings += absolute(_pair(samples, trajectories, source.unit), source)
    return CheckResult(tuple(findings))


def _left_aside(count: int) -> Finding:
    return Finding("overlap", "note", f"{count} measurements are with robots that have no trajectory")


def _pair(samples: PairSamples, trajectories: Mapping[str, Trajectory], unit: LengthUnit) -> Sequence[Finding]:
    findings = [*_covered(samples, trajectories), *_gaps(samples), *_repeated(samples)]
    ranges = check_ranges(samples, trajectories, 0, unit)
    clock, shift_ns = None, 0
    if not any(f.topic == "unit" and f.level == "suspect" for f in ranges.findings):
        clock, shift_s = check_clock(samples, trajectories)
        shift_ns = round(shift_s * 1e9)
    if shift_ns:
        ranges = check_ranges(samples, trajectories, shift_ns, unit)
    findings += [*ranges.findings, *([] if clock is None else [clock])]
    return [*findings, *check_bearings(samples, trajectories, ranges.fit, shift_ns)]


def _covered(samples: PairSamples, trajectories: Mapping[str, Trajectory]) -> list[Finding]:
    inside = samples.covered(trajectories)
    if inside.all():
        return []
    text = f"{int((~inside).sum())} of {len(inside)} measurements lie outside the time of both trajectories"
    return [Finding("overlap", "suspect" if inside.mean() < 0.5 else "note", text, samples.robots)]


def _gaps(samples: PairSamples) -> list[Finding]:
    gaps_s = np.diff(np.unique(samples.stamps_ns)) * 1e-9
    if not len(gaps_s):
        return []
    limit_s = max(_GAP_S, _GAP_INTERVALS * float(np.median(gaps_s)))
    long = gaps_s[np.greater(gaps_s, limit_s)]
    if not len(long):
        return []
    text = f"{len(long)} gaps longer than {limit_s:.3g} s, the longest {long.max():.3g} s"
    return [Finding("gaps", "note", text, samples.robots)]


def _repeated(samples: PairSamples) -> list[Finding]:
    ranges = samples.ranges_m[np.isfinite(samples.ranges_m)]
    if len(ranges) < 20:
        return []
    held = float(np.mean(np.diff(ranges) == 0))
    steps = np.unique(np.abs(np.diff(ranges)))
    coarse = steps[steps > 0].min() if (steps > 0).any() else 0.0
    if held < _HELD or coarse > 0.05 * max(float(np.std(ranges)), 1e-9):
        return []
    text = f"{100 * held:.0f} % of the ranges repeat the one before to the last digit: the driver holds old values"
    return [Finding("repeated", "suspect", text, samples.robots)]


def _agree(values: Sequence[object]) -> bool:
    numbers = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    if len(numbers) == len(values):
        return max(numbers) - min(numbers) <= 0.1 + 0.01 * max(map(abs, numbers))
    return all(value == values[0] for value in values)
