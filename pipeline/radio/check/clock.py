"""The log's clock held against the trajectories': no overlap at all, or a shift of seconds that fits better."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.check.geometry import PairSamples
from wiclosure.pipeline.radio.check.range_fit import FEWEST, best_rms_m
from wiclosure.types import FloatArray, Trajectory

_MOST = 150  # ranges of a pair that are fitted at each shift
_WITHIN_S = 30.0
_COARSE_S = 0.5
_FINE_S = 0.05
_BETTER = 1.3  # the fit must get so many times better: drift of odometry can imitate a little
_SURE = 25.0  # twice the gain in log likelihood: five sigma
_HOUR_NS = 3600 * 10**9
_EPOCH_NS = 10**17  # 1973: times below are since some start


@dataclass(frozen=True, slots=True)
class Span:
    """First and last time."""

    first_ns: int
    last_ns: int

    def overlaps(self, other: Span) -> bool:
        """Whether they share a time."""
        return self.first_ns <= other.last_ns and other.first_ns <= self.last_ns

    def mostly_in(self, other: Span) -> bool:
        """Whether they share at least half of this span."""
        shared_ns = min(self.last_ns, other.last_ns) - max(self.first_ns, other.first_ns)
        return self.overlaps(other) and shared_ns >= (self.last_ns - self.first_ns) // 2


def common_span(trajectories: Mapping[str, Trajectory]) -> Span:
    """From the first pose of any robot to the last."""
    return Span(
        min(int(t.stamps_ns[0]) for t in trajectories.values()),
        max(int(t.stamps_ns[-1]) for t in trajectories.values()),
    )


def check_overlap(log: Span, poses: Span) -> Finding | None:
    """What is wrong with a log that shares no time with the trajectories; None where it does."""
    if log.overlaps(poses):
        return None
    apart = f"the log covers {_span(log)}, the trajectories {_span(poses)}: no overlap"
    for power, unit in ((3, "ms"), (6, "us"), (9, "ns")):
        if Span(log.first_ns // 10**power, log.last_ns // 10**power).mostly_in(poses):
            return Finding("overlap", "suspect", f"{apart}; read as {unit} the stamps fit", None, {"stamp_unit": unit})
        if Span(log.first_ns * 10**power, log.last_ns * 10**power).mostly_in(poses):
            text = f"{apart}; 10^{power} times the stamps would fit: they were read in too small a unit"
            return Finding("overlap", "suspect", text, None, {"stamp_unit": {3: "ms or us", 6: "ms", 9: "s"}[power]})
    half_hours = round((poses.first_ns - log.first_ns) / (_HOUR_NS // 2))
    moved_ns = half_hours * (_HOUR_NS // 2)
    if abs(half_hours) <= 28 and Span(log.first_ns + moved_ns, log.last_ns + moved_ns).mostly_in(poses):
        hours = half_hours / 2
        text = f"{apart}; moved by {hours:+g} hours it fits: a time zone"
        return Finding("overlap", "suspect", text, None, {"time_offset": round(hours * 3600)})
    if (log.first_ns < _EPOCH_NS) != (poses.first_ns < _EPOCH_NS):
        offset_s = (poses.first_ns - log.first_ns) * 1e-9
        since = "the log's stamps count" if log.first_ns < _EPOCH_NS else "the trajectories' stamps count"
        text = f"{apart}; {since} from some start, the others from 1970: if both began together, the offset is as below"
        return Finding("overlap", "suspect", text, None, {"time_offset": round(offset_s, 3)})
    return Finding("overlap", "suspect", f"{apart}; no unit and no time zone explains it: other recordings?")


def check_clock(samples: PairSamples, trajectories: Mapping[str, Trajectory]) -> tuple[Finding | None, float]:
    """Whether some shift of the log's stamps makes the ranges fit the paths better, and that shift in seconds (or 0).

    The fit without refinement is made at each shift within half a minute, coarse and then fine.
    """
    samples = samples.select(np.isfinite(samples.ranges_m))
    margin_ns = round((_WITHIN_S + 1) * 1e9)
    inside = samples.covered(trajectories, -margin_ns) & samples.covered(trajectories, margin_ns)
    if inside.sum() < 3 * FEWEST:  # a short log: shifts are tried as far as most of it stays inside
        inside = samples.covered(trajectories)
    if inside.sum() < 3 * FEWEST:
        return None, 0.0
    indices = np.flatnonzero(inside)
    samples = samples.select(indices[np.unique(np.linspace(0, len(indices) - 1, _MOST).astype(np.int64))])
    coarse = np.arange(-_WITHIN_S, _WITHIN_S + _COARSE_S / 2, _COARSE_S)
    rough = _rms_at(samples, trajectories, coarse)
    middle = coarse[int(np.nanargmin(rough))]
    fine = middle + np.arange(-_COARSE_S, _COARSE_S + _FINE_S / 2, _FINE_S)
    close = _rms_at(samples, trajectories, fine)
    best_s, best_m = float(fine[int(np.nanargmin(close))]), float(np.nanmin(close))
    now_m = float(_rms_at(samples, trajectories, np.zeros(1))[0])
    gain = 2 * len(samples.ranges_m) * np.log(max(now_m / max(best_m, 1e-6), 1e-6))
    pair = samples.robots
    if now_m > _BETTER * best_m and gain > _SURE and abs(best_s) >= 2 * _FINE_S:
        text = f"with stamps {best_s:+.2f} s the ranges fit the paths to {best_m:.2g} m instead of {now_m:.2g} m"
        return Finding("clock", "suspect", text, pair, {"time_offset": round(best_s, 2)}), best_s
    worse = np.nanmax(rough)
    if worse > 2 * now_m:
        return Finding("clock", "good", f"no shift of the stamps fits better ({now_m:.2g} m as they are)", pair), 0.0
    return Finding("clock", "note", "the paths are too even to tell the clock's offset from the ranges", pair), 0.0


def _rms_at(samples: PairSamples, trajectories: Mapping[str, Trajectory], shifts_s: FloatArray) -> FloatArray:
    """Best fit at each shift, metres; NaN where less than half of the ranges lie within the trajectories."""
    found = np.full(len(shifts_s), np.nan)
    for number, shift_s in enumerate(shifts_s):
        shift_ns = round(float(shift_s) * 1e9)
        inside = samples.covered(trajectories, shift_ns)
        if inside.sum() >= max(FEWEST, len(inside) // 2):
            chosen = samples.select(inside)
            found[number] = best_rms_m(*chosen.antennas(trajectories, shift_ns), chosen.ranges_m)
    return found


def _span(span: Span) -> str:
    return f"{span.first_ns * 1e-9:.1f} to {span.last_ns * 1e-9:.1f} s"
