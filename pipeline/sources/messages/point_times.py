"""What per-point times mean: unit and reference differ from driver to driver and are stated nowhere.

**Unit.**  A sweep of a LiDAR lasts 0.02 to 1 s.  So the unit is the largest of s, ms, us, ns in which the sweep takes
no longer than 1.5 s: neighbouring units differ a thousandfold, a sweep of 20 ms or more fits only one of them, and a
first sweep of which only 2 % were recorded still does.  Where the time between scans is known, the unit is, of those
in which the sweep is that short, the one by which it comes nearest to it: drivers that publish every packet send sweeps
of a millisecond.  Absolute times of a dated recording tell their unit by their size alone.  The unit is decided on the
first sweep, logged, and kept, until a later sweep would last longer than 1.5 s by it.  Some drivers count in 10 us,
100 us or 100 ns.  Such a unit is taken, and said, where a sweep fills the time between scans by it, of which it would
take a tenth or less by all others.

**Reference.**  Times count from the header's stamp (which may be the sweep's start, middle or end: they may be
negative) or from an epoch (see `formats.epochs`).  Whichever of zero and the stamp lies nearer to the sweep is the
reference.  When neither is near (1.5 s; for zero two sweeps), the sensor has a clock of its own (since power-on, TAI):
the earliest point is put at the stamp.  Two such sweeps in a row, and it is not asked again: that clock may pass zero.

**Strays.**  A scan's pose belongs to its last point, so one wrong time would put a whole scan out of order.  Times that
lie outside the span of the middle 98 % by more than that span again are taken for wrong, and their points are left out.
That is 1 % of the points at either end at most; if more than that are late, they are part of the sweep.
"""

from __future__ import annotations

import logging
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wiclosure.formats.epochs import UNIX, Epoch, epochs_at
from wiclosure.formats.radio.radio_units import NANOSECONDS
from wiclosure.pipeline.sources.messages.wrapped_times import counter_range, unwrapped
from wiclosure.types import FloatArray

logger = logging.getLogger(__name__)

LONGEST_SWEEP_S = 1.5
_NS_PER_UNIT = (10**9, 10**6, 10**3, 1)  # s, ms, us, ns: the largest that fits is taken
_RARE_NS_PER_UNIT = (10**5, 10**4, 100)
_FULL = (0.95, 1.02)  # of the time between scans a sweep takes that has no gap
_OWN_SWEEPS = 2  # in a row that count from neither zero nor the stamp: the sensor's clock is its own
_DATED_S = 1e8  # stamps beyond 1973 are dates: absolute times are then told from relative ones by their size
_OTHER_EPOCH_S = 100.0  # TAI and GPS clocks are 18 to 37 s off; the unit is still certain
_RARE = 0.01  # share of points at either end that must not decide the unit, and that may be strays
_SOME = 8
_FEWEST = 20  # points; among fewer nothing can be called rare
_UNLIKELY = (
    30.0  # a sweep so many times shorter or longer than the time between scans has its unit wrong, or lost parts
)
_UNIT_NAMES = {nanoseconds: unit for unit, nanoseconds in NANOSECONDS.items()}


class PointClock:
    """Turns the per-point times of one recording into seconds after each header's stamp.

    Args:
        place: what is read, for the log.
        period_s: seconds from scan to scan, where they are known.
        ns_per_unit: nanoseconds per unit of the recorded times, where they are known.
    """

    def __init__(self, place: str = "", period_s: float | None = None, ns_per_unit: int | None = None) -> None:
        self._place, self._period_s = place or "point clouds", period_s
        self._ns_per_unit = ns_per_unit
        self._epoch = UNIX
        self._own_sweeps = 0
        self._warned = False

    def seconds_after(self, stamp_ns: int, raw: NDArray[Any]) -> FloatArray | None:
        """Times `(N,)` in seconds after `stamp_ns`, or None where they say nothing.

        Args:
            stamp_ns: the header's stamp.
            raw: `(N,)` finite numbers of any type, as recorded.
        """
        values = raw.astype(np.float64 if raw.dtype.kind == "f" else np.int64, copy=False)
        if len(values) == 0:
            return None
        first, last = values.min().item(), values.max().item()  # Python's numbers never overflow
        if (size := counter_range(values, first, last)) is not None:
            values = unwrapped(values, size, goes_on=self._own_sweeps > 0)
            first, last = values.min().item(), values.max().item()
        if first == last and self._ns_per_unit is None:
            return None  # all at once, or a field that nobody filled
        span = float(last - first)
        if self._ns_per_unit is None or span * self._ns_per_unit > self._longest_ns:
            self._ns_per_unit, self._epoch = _decide_unit(values, stamp_ns, self._period_s)
            self._state(span * self._ns_per_unit * 1e-9)
        if span * self._ns_per_unit > LONGEST_SWEEP_S * 1e9:
            self._warn_once(span * self._ns_per_unit * 1e-9)
            return None
        return self._relative(values, first, last, stamp_ns + self._epoch.before_1970_ns)

    @property
    def _is_own(self) -> bool:
        """Whether the sensor counts by a clock of its own."""
        return self._own_sweeps >= _OWN_SWEEPS

    @property
    def _longest_ns(self) -> float:
        """Beyond this, a sweep says that the unit was another."""
        if self._ns_per_unit in _RARE_NS_PER_UNIT and self._period_s:
            return LONGEST_SWEEP_S * 1e9 * min(self._period_s, 1.0)
        return LONGEST_SWEEP_S * 1e9

    def _relative(self, values: NDArray[Any], first: Any, last: Any, stamp_ns: int) -> FloatArray:
        """Seconds after the stamp, by the nearer reference.

        Integers stay integers until the difference is taken: nanoseconds since 1970 do not fit a float64.
        """
        ns_per_unit = self._ns_per_unit or 1
        unit_s = ns_per_unit * 1e-9
        stamp = stamp_ns // ns_per_unit if values.dtype.kind == "i" else stamp_ns / ns_per_unit
        beyond_zero = max(first, -last, 0) * unit_s
        beyond_stamp = max(first - stamp, stamp - last, 0) * unit_s
        near_zero_s = min(LONGEST_SWEEP_S, 2 * (self._period_s or LONGEST_SWEEP_S))
        is_zero = beyond_zero <= beyond_stamp and beyond_zero <= near_zero_s
        if not is_zero and beyond_stamp > LONGEST_SWEEP_S:
            self._own_sweeps += not self._is_own
            return _seconds(values - first, ns_per_unit)
        if is_zero and self._is_own:
            return _seconds(values - first, ns_per_unit)
        self._own_sweeps = 0
        if is_zero:
            return _seconds(values, ns_per_unit)
        after = _seconds(values - stamp, ns_per_unit)
        if values.dtype.kind == "i":
            after -= (stamp_ns - stamp * ns_per_unit) * 1e-9
        return after

    def _state(self, span_s: float) -> None:
        unit: str = _UNIT_NAMES[self._ns_per_unit or 1]
        unit = unit if self._epoch is UNIX else f"{unit} {self._epoch.name}"
        logger.info("%s: per-point times are in %s; the first sweep lasts %.4g s", self._place, unit, span_s)
        if self._ns_per_unit in _RARE_NS_PER_UNIT and self._epoch is UNIX:
            logger.warning(
                "%s: per-point times are taken to be in units of %s: only so does a sweep fill the %.3g s between"
                " scans", self._place, unit, self._period_s or span_s,
            )  # fmt: skip
        if self._period_s and not 1 / _UNLIKELY < span_s / self._period_s < _UNLIKELY:
            logger.warning(
                "%s: a sweep lasts %.3g s by its points' times, but scans come every %.3g s; check the field",
                self._place, span_s, self._period_s,
            )  # fmt: skip

    def _warn_once(self, span_s: float) -> None:
        if not self._warned:
            logger.warning(
                "%s: per-point times of one sweep span %.3g s; such sweeps are used without them", self._place, span_s
            )
            self._warned = True


def strays(raw: NDArray[Any]) -> NDArray[np.bool_] | None:
    """Which of the recorded times `(N,)`, finite numbers, lie so far from nearly all others that they must be wrong.

    None: none does.
    """
    if len(raw) < _FEWEST:
        return None
    rare = math.ceil(_RARE * len(raw))
    if _fill_both_ends(raw, rare):
        return None
    times = raw.astype(np.float64, copy=False)  # good to 256 ns for nanoseconds since 1970: far below any span
    low, high = np.partition(times, [rare, len(times) - 1 - rare])[[rare, len(times) - 1 - rare]]
    found = (times < low - (high - low)) | (times > high + (high - low))
    return np.asarray(found) if found.any() else None


def _fill_both_ends(raw: NDArray[Any], rare: int) -> bool:
    """Whether the first and the last third of the span hold more than the rare points each.

    Then the middle 98 % span more than a third of it, and nothing lies that far outside of them: most sweeps are let
    through by this, which takes a tenth of the time of the quantiles.
    """
    first, last = raw.min().item(), raw.max().item()
    third = (last - first) / 3
    some = raw[::_SOME]  # what they hold of these, they hold of all
    return bool(np.count_nonzero(some < first + third) > rare + 1 and np.count_nonzero(some > last - third) > rare + 1)


def _decide_unit(values: NDArray[Any], stamp_ns: int, period_s: float | None) -> tuple[int, Epoch]:
    """Nanoseconds per unit of the recorded times, and what they count from where they are dates."""
    low, middle, high = np.quantile(values, [_RARE, 0.5, 1 - _RARE], method="nearest")
    first, last = values.min().item(), values.max().item()
    span = float(high.item() - low.item()) or float(last - first)
    if stamp_ns > _DATED_S * 1e9 and (dated := _dated(float(middle), span, stamp_ns, period_s)) is not None:
        return dated
    fitting = [ns for ns in _NS_PER_UNIT if span * ns <= LONGEST_SWEEP_S * 1e9] or [_NS_PER_UNIT[-1]]
    if not period_s or span <= 0:
        return fitting[0], UNIX
    usual = min(fitting, key=lambda ns: abs(math.log(span * ns * 1e-9 / period_s)))
    by_usual = (last - first) * usual * 1e-9 / period_s
    rare = (ns for ns in _RARE_NS_PER_UNIT if _FULL[0] <= (last - first) * ns * 1e-9 / period_s <= _FULL[1])
    return (usual if by_usual > _FULL[1] / 10 and by_usual < 10 * _FULL[0] else next(rare, usual)), UNIX


def _dated(middle: float, span: float, stamp_ns: int, period_s: float | None) -> tuple[int, Epoch] | None:
    """Unit and epoch by which the middle of a sweep lies near its stamp; None where the times are no dates."""
    for epoch in epochs_at(stamp_ns):
        expected_ns = stamp_ns + epoch.before_1970_ns
        if expected_ns < 10 * _OTHER_EPOCH_S * 1e9:
            continue  # soon after midnight: any small number would do
        for ns_per_unit in NANOSECONDS.values():
            of_period = span * ns_per_unit * 1e-9 / (period_s or LONGEST_SWEEP_S)
            can_be = of_period <= 1 if period_s is None else 1 / _UNLIKELY < of_period < _UNLIKELY
            if abs(middle * ns_per_unit - expected_ns) < _OTHER_EPOCH_S * 1e9 and (epoch is UNIX or can_be):
                return ns_per_unit, epoch
    return None


def _seconds(ticks: NDArray[Any], ns_per_unit: int) -> FloatArray:
    """Ticks in seconds; a new array only where something changes."""
    if ticks.dtype.kind == "f" and ns_per_unit == _NS_PER_UNIT[0]:
        return ticks
    return np.asarray(ticks * (ns_per_unit * 1e-9))
