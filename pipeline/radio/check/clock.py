"""The log's clock held against the trajectories': no overlap at all, or a shift of seconds that fits better."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from wiclosure.formats.epochs import other_epoch
from wiclosure.formats.radio.radio_units import NANOSECONDS, TimeUnit
from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.check.geometry import PairSamples
from wiclosure.pipeline.radio.check.range_fit import FEWEST, RangeFit, fit_ranges, refit
from wiclosure.types import FloatArray, Trajectory

_FEWEST = 16  # ranges of a pair: four numbers of the fit, the shift, and enough to see that they agree
_MOST = 150  # ranges of a pair that are fitted at each shift
_WITHIN_S = 30.0
_COARSE_S = 0.5
_FINE_S = 0.05
_BETTER = 1.3  # the fit must get so many times better: drift of odometry can imitate a little
_LEAST_GAIN_M = 0.1  # below, the offset of a slow robot's clock does no harm
_INSIDE = 0.8  # of the ranges must stay within the trajectories: fewer always fit better
_SURE = 25.0  # twice the gain in log likelihood: five sigma
_HOUR_NS = 3600 * 10**9
_EPOCH_NS = 10**17  # 1973: times below are since some start


class Span(NamedTuple):
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


def check_overlap(log: Span, poses: Span, read: TimeUnit = "s") -> Finding | None:
    """What is wrong with a log that shares no time with the trajectories; None where it does.

    Args:
        log: of the measurements, by stamps that were read in the unit `read`.
        poses: of the trajectories.
        read: unit of the log's stamps, as it was taken.
    """
    if log.overlaps(poses):
        return None
    apart = f"the log covers {_span(log)}, the trajectories {_span(poses)}: no overlap"
    # First what keeps the log as long as it is: as milliseconds, a short one fits nearly anywhere.
    half_hours = round((poses.first_ns - log.first_ns) / (_HOUR_NS // 2))
    moved_ns = half_hours * (_HOUR_NS // 2)
    if abs(half_hours) <= 28 and Span(log.first_ns + moved_ns, log.last_ns + moved_ns).mostly_in(poses):
        hours = half_hours / 2
        text = f"{apart}; moved by {hours:+g} hours it fits: a time zone"
        return Finding("overlap", "suspect", text, None, {"time_offset": round(hours * 3600)})
    as_read = NANOSECONDS.get(read, 100)
    for unit, ns in NANOSECONDS.items():
        if ns != as_read and Span(log.first_ns * ns // as_read, log.last_ns * ns // as_read).mostly_in(poses):
            return Finding("overlap", "suspect", f"{apart}; read as {unit} the stamps fit", None, {"stamp_unit": unit})
    if (epoch := other_epoch(*log, *poses)) is not None:
        offset_s = -epoch.before_1970_ns * 1e-9
        text = f"{apart}; the log's stamps fit as times {epoch.name}"
        return Finding("overlap", "suspect", text, None, {"time_offset": round(offset_s)})
    if (log.first_ns < _EPOCH_NS) != (poses.first_ns < _EPOCH_NS):
        offset_s = (poses.first_ns - log.first_ns) * 1e-9
        since = "the log's stamps count" if log.first_ns < _EPOCH_NS else "the trajectories' stamps count"
        text = f"{apart}; {since} from some start, the others from 1970: if both began together, the offset is as below"
        return Finding("overlap", "suspect", text, None, {"time_offset": round(offset_s, 3)})
    return Finding("overlap", "suspect", f"{apart}; no unit and no time zone explains it: other recordings?")


def check_clock(samples: PairSamples, trajectories: Mapping[str, Trajectory]) -> tuple[Finding | None, float]:
    """Whether some shift of the log's stamps makes the ranges fit the paths better, and that shift in seconds (or 0).

    The fit is followed from the stamps as they are, half a minute both ways, and then finely around the best.
    """
    chosen = _chosen(samples, trajectories)
    fit = None if chosen is None else fit_ranges(*_placed(chosen, trajectories, 0.0))
    if chosen is None or fit is None:
        text = f"too few ranges within both trajectories to tell the clock's offset ({_FEWEST} are needed)"
        return (Finding("clock", "note", text, samples.robots) if np.isfinite(samples.ranges_m).any() else None), 0.0
    samples = chosen
    steps = np.arange(0.0, _WITHIN_S + _COARSE_S / 2, _COARSE_S)
    followed = [*_follow(samples, trajectories, -steps, fit), *_follow(samples, trajectories, steps, fit)]
    middle_s, middle = min(followed, key=lambda entry: entry[1].rms_m)
    fine = middle_s + np.arange(-_COARSE_S, _COARSE_S + _FINE_S / 2, _FINE_S)
    best_s, best = min(_follow(samples, trajectories, fine, middle), key=lambda entry: entry[1].rms_m)
    now = min((entry[1] for entry in followed if entry[0] == 0), key=lambda found: found.rms_m)
    gain = 2 * len(samples.ranges_m) * np.log(max(now.rms_m, 1e-6) / max(best.rms_m, 1e-6))
    pair = samples.robots
    better = now.rms_m > _BETTER * best.rms_m and now.rms_m - best.rms_m > _LEAST_GAIN_M and gain > _SURE
    if better and abs(best_s) >= 2 * _FINE_S:
        text = f"with stamps {best_s:+.2f} s the ranges fit the paths to {best.rms_m:.2g} m, not {now.rms_m:.2g} m"
        return Finding("clock", "suspect", text, pair, {"time_offset": round(best_s, 2)}), best_s
    if max(entry[1].rms_m for entry in followed) > 2 * now.rms_m:
        text = f"no shift of the stamps within {_WITHIN_S:.0f} s fits better ({now.rms_m:.2g} m as they are)"
        return Finding("clock", "good", text, pair), 0.0
    return Finding("clock", "note", "the paths are too even to tell the clock's offset from the ranges", pair), 0.0


def _chosen(samples: PairSamples, trajectories: Mapping[str, Trajectory]) -> PairSamples | None:
    """Ranges that stay within the trajectories while the clock is moved, where there are enough; not too many."""
    samples = samples.select(np.isfinite(samples.ranges_m))
    margin_ns = round(_WITHIN_S * 1e9)
    inside = samples.covered(trajectories, -margin_ns) & samples.covered(trajectories, margin_ns)
    if inside.sum() < _FEWEST:  # a short log: shifts are tried as far as most of it stays inside
        inside = samples.covered(trajectories)
    if inside.sum() < _FEWEST:
        return None
    indices = np.flatnonzero(inside)
    return samples.select(indices[np.unique(np.linspace(0, len(indices) - 1, _MOST).astype(np.int64))])


def _follow(
    samples: PairSamples, trajectories: Mapping[str, Trajectory], shifts_s: FloatArray, start: RangeFit
) -> list[tuple[float, RangeFit]]:
    """The fit at each shift, each begun at the one before; shifts that leave too few ranges inside are left out."""
    found: list[tuple[float, RangeFit]] = []
    for shift_s in shifts_s:
        a, b, ranges = _placed(samples, trajectories, float(shift_s))
        if len(ranges) >= max(FEWEST, _INSIDE * len(samples.ranges_m)):
            start = refit(a, b, ranges, start)
            found.append((float(shift_s), start))
    return found


def _placed(
    samples: PairSamples, trajectories: Mapping[str, Trajectory], shift_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Antennas and ranges with the stamps moved, of those that lie within both trajectories then."""
    shift_ns = round(shift_s * 1e9)
    inside = samples.select(samples.covered(trajectories, shift_ns))
    return *inside.antennas(trajectories, shift_ns), inside.ranges_m


def _span(span: Span) -> str:
    return f"{span.first_ns * 1e-9:.1f} to {span.last_ns * 1e-9:.1f} s"
