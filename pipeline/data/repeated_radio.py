"""Measurements that several logs hold: a table that a node wrote of what stands in the bags too, with fewer digits."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np
from scipy.spatial import KDTree

from wiclosure.types import BoolArray, FloatArray, WirelessLog, WirelessMeasurement

logger = logging.getLogger(__name__)

_FINEST_STAMP_NS, _FINEST_RANGE_M = 1_000, 1e-5  # what single and double precision leave of them
_FEWEST_ON_A_LINE = 8  # measurements; two numbers fit the line
_DIGITS_OFF = 1e-3  # of the last digit, by which a number that has no more digits may miss it


def each_once(logs: Sequence[tuple[str, WirelessLog]]) -> WirelessLog:
    """All logs, given with their names, as one in which each measurement is once.

    Records that are equal to the last bit are one.  Others are if robots, stamp and range are alike to the last digit
    that both logs have, and so is most of the shorter log: two radios that measure side by side are seldom so alike.
    Then the log with bearings is kept, or the one that stands first.
    """
    measurements = _without_equals([log.measurements for _, log in logs])
    headings = tuple(dict.fromkeys(heading for _, log in logs for heading in log.headings))
    total = sum(len(log.measurements) + len(log.headings) for _, log in logs)
    if repeated := total - sum(map(len, measurements)) - len(headings):
        logger.info("%d wireless records are in several logs or bags and count once", repeated)
    for i, j in combinations(range(len(logs)), 2):
        same_i, same_j = _alike(measurements[i], measurements[j])
        if not any(same_i):
            _warn_of_another_unit(*((logs[k][0], measurements[k]) for k in (i, j)))
            continue
        less, more, same = (i, j, same_i) if _bearings(measurements[j]) > _bearings(measurements[i]) else (j, i, same_j)
        logger.warning(
            "%s: %d of %d measurements are in %s too, and count once; leave one of the two out",
            logs[less][0], np.count_nonzero(same), len(same), logs[more][0],
        )  # fmt: skip
        measurements[less] = [m for m, again in zip(measurements[less], same, strict=True) if not again]
    return sum((WirelessLog(tuple(of_one)) for of_one in measurements), WirelessLog(headings=headings))


def _without_equals(logs: Iterable[Sequence[WirelessMeasurement]]) -> list[list[WirelessMeasurement]]:
    seen, kept = set[WirelessMeasurement](), []
    for log in logs:
        new = [m for m in dict.fromkeys(log) if m not in seen]
        seen.update(new)
        kept.append(new)
    return kept


def _bearings(log: Sequence[WirelessMeasurement]) -> int:
    return sum(bool(m.paths) for m in log)


def _alike(one: Sequence[WirelessMeasurement], other: Sequence[WirelessMeasurement]) -> tuple[BoolArray, BoolArray]:
    """Which measurements of each log are in the other too, robots by robots."""
    same = np.zeros(len(one), bool), np.zeros(len(other), bool)
    rows = [_ranged(log) for log in (one, other)]
    for robots in rows[0].keys() & rows[1].keys():
        at = [of[robots] for of in rows]
        values = [
            np.array([[log[k].stamp_ns - one[at[0][0]].stamp_ns, log[k].range_m] for k in rows_of], np.float64)
            for log, rows_of in zip((one, other), at, strict=True)
        ]
        reach = _reach(*(_last_digits(of, one[at[0][0]].stamp_ns) for of in values))
        near = [
            np.isfinite(KDTree(b / reach).query(a / reach, p=np.inf, distance_upper_bound=1 + _DIGITS_OFF)[0])
            for a, b in (values, values[::-1])
        ]
        if 2 * max(np.count_nonzero(of) / len(of) for of in near) > 1:
            for marked, rows_of, found in zip(same, at, near, strict=True):
                marked[rows_of] = found
    return same


def _warn_of_another_unit(
    one: tuple[str, Sequence[WirelessMeasurement]], other: tuple[str, Sequence[WirelessMeasurement]]
) -> None:
    """One log that is read twice, once with another unit or offset: at equal times ranges follow one straight line.

    Two radios side by side scatter about such a line.
    """
    rows = [_ranged(log) for _, log in (one, other)]
    for robots in rows[0].keys() & rows[1].keys():
        at = [
            {log[k].stamp_ns: log[k].range_m for k in of[robots]}
            for (_, log), of in zip((one, other), rows, strict=True)
        ]
        common = sorted(at[0].keys() & at[1].keys())
        if len(common) < _FEWEST_ON_A_LINE or 2 * len(common) <= min(map(len, at)):
            continue
        x, y = (np.array([of[ns] for ns in common], np.float64) for of in at)
        scale, offset = np.polyfit(x, y, 1) if np.ptp(x) > 0 else (0.0, 0.0)
        digit = max(_last_digits(np.column_stack([common, of]), 0)[1] for of in (x, y))
        if scale > 0 and np.ptp(y) > 100 * digit and np.max(np.abs(scale * x + offset - y)) <= digit * max(1.0, scale):
            logger.warning(
                "%s and %s hold %d measurements of %s at the same times, with ranges %.4g times as long and %.2f m more"
                " in the second: one log in two units or with two offsets? Both are used; leave one of the two out",
                one[0], other[0], len(common), " and ".join(sorted(robots)), scale, offset,
            )  # fmt: skip


def _ranged(log: Sequence[WirelessMeasurement]) -> dict[frozenset[str], list[int]]:
    """Rows of the measurements with a range, by their robots: which of the two is called the receiver is a habit."""
    rows: dict[frozenset[str], list[int]] = {}
    for row, m in enumerate(log):
        if m.range_m is not None:
            rows.setdefault(frozenset({m.receiver, m.transmitter}), []).append(row)
    return rows


def _reach(one: FloatArray, other: FloatArray) -> FloatArray:
    """How far stamps and ranges that were one may lie apart: a digit where one log has fewer, else next to nothing."""
    alike = np.maximum(_DIGITS_OFF * one, [_FINEST_STAMP_NS, _FINEST_RANGE_M])
    return np.asarray(np.where(one == other, alike, np.maximum(one, other)))


def _last_digits(values: FloatArray, origin_ns: int) -> FloatArray:
    """What one step of the last digit is worth in the stamps and ranges `(N, 2)`, in ns and m."""
    ns = values[:, 0].astype(np.int64) + origin_ns
    stamp_ns = next((unit for unit in 10 ** np.arange(9, 3, -1) if not np.any(ns % unit)), _FINEST_STAMP_NS)
    tens = values[:, 1] * 10.0 ** np.arange(5)[:, None]
    whole = np.all(np.abs(tens - np.rint(tens)) < _DIGITS_OFF * 10.0 ** np.arange(5)[:, None] / 10, axis=1)
    range_m = 10.0 ** -float(np.argmax(whole)) if whole.any() else _FINEST_RANGE_M
    return np.array([stamp_ns, max(range_m, _FINEST_RANGE_M)], np.float64)
