"""What numbers in files can mean: beyond these bounds they are damaged, or something else than they are taken for."""

from __future__ import annotations

import logging
import math

import numpy as np

from wiclosure.errors import InputError
from wiclosure.types import BoolArray, FloatArray, IntArray

logger = logging.getLogger(__name__)

LATEST_NS = 7_258_118_400 * 10**9
"""The year 2200.  Recordings are dated, or count from a zero of their own (simulators, clocks since power-on)."""
FURTHEST_M = 1e7
"""Of a position: from the origin of a map, or of UTM coordinates, or from the centre of the Earth."""
LONGEST_QUATERNION = 1e6
"""Whoever normalises none writes none so long."""
FEW = 0.05
"""Share of values that may be damaged and are left out; more, and all of them are in doubt."""
_NOT_A_ROTATION = 0.01  # rotations printed with three digits stay within this of orthonormal
_FASTEST_M_S = 340.0
_FAR_STEP_M = 100.0  # stamps jitter: what moves less is not said to be fast
_LONG_NS = 86_400 * 10**9


def few(count: int, total: int) -> bool:
    """Whether so many values of all may be left out; one always."""
    return count <= max(1, math.floor(FEW * total))


def plausible_path(place: object, stamps_ns: IntArray, positions_m: FloatArray) -> BoolArray:
    """Which poses `(N,)` of a path can be; those left out, leaps and long gaps are said.

    Raises:
        InputError: more than a few lie beyond all places.
    """
    keep = plausible_rows(place, "positions", positions_m, FURTHEST_M, "expected metres from an origin nearby")
    _say_leaps(place, stamps_ns[keep], positions_m[keep])
    return keep


def plausible_rows(place: object, what: str, values: FloatArray, most: float | FloatArray, way_out: str) -> BoolArray:
    """Which rows `(N,)` of values `(N, K)` are numbers below a bound, of all or of each column; few others are said.

    Raises:
        InputError: more than a few are not.
    """
    keep = np.asarray((np.abs(values) <= most).all(axis=1))  # false for NaN
    if out := int(np.count_nonzero(~keep)):
        example = ", ".join(f"{number:.6g}" for number in values[int(np.argmin(keep))])
        bound = ", ".join(f"{number:g}" for number in np.atleast_1d(most))
        said = f"{place}: {out} of {len(keep)} {what} lie beyond {bound}, as {example}"
        if not few(out, len(keep)):
            raise InputError(f"{said}; {way_out}")
        logger.warning("%s; they are left out", said)
    return keep


def _say_leaps(place: object, stamps_ns: IntArray, positions_m: FloatArray) -> None:
    step_m, step_ns = np.linalg.norm(np.diff(positions_m, axis=0), axis=1), np.diff(stamps_ns)
    fast = (step_m > _FAR_STEP_M) & (step_m > _FASTEST_M_S * 1e-9 * step_ns)
    for what, odd in (("faster than sound", fast), ("longer than a day", np.abs(step_ns) > _LONG_NS)):
        if odd.any():
            first = int(np.argmax(odd))
            logger.warning(
                "%s: %d of %d steps are %s, the first of %.6g m in %.6g s after the stamp %.3f; is the file damaged?",
                place, np.count_nonzero(odd), len(odd), what, step_m[first], step_ns[first] * 1e-9,
                stamps_ns[first] * 1e-9,
            )  # fmt: skip


def require_rotation(place: object, R: FloatArray) -> None:
    """Refuses a matrix `(3, 3)` that is no rotation.

    Raises:
        InputError: it is not finite, not orthonormal, or mirrored.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        is_one = np.abs(R @ R.T - np.eye(3)).max() < _NOT_A_ROTATION and np.linalg.det(R) > 0
    if not is_one:
        raise InputError(f"{place}: not a rotation (its rows are not orthonormal); correct it, or take the file away")
