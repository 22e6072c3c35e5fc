"""Times of points whose counter began anew within the sweep: 32 bits of nanoseconds do so every 4.3 s.

The sweep then stands at both ends of the counter's range with nothing between.  That tells the range, if it is one that
counters have: 2^32, or a second, minute, hour, day or week in s, ms, us or ns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_RANGES = sorted({2**32, *(s * unit for s in (1, 60, 3600, 86_400, 604_800) for unit in (1, 10**3, 10**6, 10**9))})
_SEAM = 0.25  # of the sweep may be missing where the counter begins anew: sectors without returns
_SOME = 8
_FEWEST = 20


def counter_range(raw: NDArray[Any], first: float, last: float) -> int | None:
    """The range of the counter that began anew within these times `(N,)`; None where it did not.

    Args:
        raw: the times.
        first: the least of them.
        last: the largest.
    """
    if len(raw) < _FEWEST:
        return None
    span = last - first
    found = next((size for size in _RANGES if size >= span), None)
    if span <= 0 or found is None or (first < 0 and found != 2**32):
        return None
    elapsed = raw - first  # exact, where a share of the span added to stamps since 1970 would be rounded
    some = elapsed[::_SOME]
    if ((some > 0.4 * span) & (some < 0.6 * span)).any():
        return None
    is_before = elapsed > span / 2
    gap = elapsed[is_before].min().item() - elapsed[~is_before].max().item()
    # A sweep of no length stands at two ticks of a coarse clock, not at both ends of a range.
    return found if gap >= span / 2 and found - span < _SEAM * (span - gap) else None


def unwrapped(raw: NDArray[Any], size: int, *, goes_on: bool) -> NDArray[Any]:
    """Times that count on through the end of their counter's range of this size.

    Args:
        raw: `(N,)` as recorded, int64 or float64.
        size: of the range.
        goes_on: those after the end are counted on from it; else those before it become negative.
    """
    elapsed = raw - raw.min()
    is_before = elapsed > elapsed.max() / 2
    return np.asarray(np.where(is_before, raw, raw + size) if goes_on else np.where(is_before, raw - size, raw))
