"""Numbers for people."""

from __future__ import annotations

import math

_SMALL = 1e-4


def significant(value: float, digits: int = 2) -> str:
    """So many significant digits, trailing zeros among them; whole numbers are not cut: 0.12, 8.0, 0.036, 123.

    What is not finite is said as Python does.
    """
    if not math.isfinite(value):
        return str(value)
    rounded = float(f"{value:.{digits - 1}e}")
    if not rounded:
        return f"{0:.{digits - 1}f}"
    if abs(rounded) < _SMALL:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - math.floor(math.log10(abs(rounded)))
    return f"{value:,.{max(0, decimals)}f}"
