"""What a radio log holds, pair by pair."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, WirelessLog, WirelessMeasurement


@dataclass(frozen=True, slots=True)
class PairSummary:
    """The measurements of one robot with another, both directions together.

    Args:
        robots: their names, sorted.
        ranges, bearings: how many measurements have one.
        first_ns, last_ns: stamps.
        interval_s: median time between two; NaN with one.
        longest_gap_s: longest time between two; NaN with one.
        range_quantiles_m: least, median and greatest range; NaN without.
        sigma_m: median of the ranges' stated standard deviations; NaN without.
    """

    robots: tuple[str, str]
    ranges: int
    bearings: int
    first_ns: int
    last_ns: int
    interval_s: float
    longest_gap_s: float
    range_quantiles_m: tuple[float, float, float]
    sigma_m: float


def pair_summaries(log: WirelessLog) -> list[PairSummary]:
    """One summary for each pair of robots, by name."""
    pairs: dict[tuple[str, str], list[WirelessMeasurement]] = {}
    for m in log.measurements:
        first, second = sorted((m.receiver, m.transmitter))
        pairs.setdefault((first, second), []).append(m)
    return [_summary(robots, pairs[robots]) for robots in sorted(pairs)]


def _summary(robots: tuple[str, str], measurements: Iterable[WirelessMeasurement]) -> PairSummary:
    listed = list(measurements)
    stamps_ns = np.array([m.stamp_ns for m in listed], np.int64)
    gaps_s = np.asarray(np.diff(np.unique(stamps_ns)), float) * 1e-9
    ranges = np.array([m.range_m for m in listed if m.range_m is not None], float)
    sigmas = np.array([m.range_sigma_m for m in listed if m.range_sigma_m is not None], float)
    low, middle, high = (_quantile(ranges, q) for q in (0, 0.5, 1))
    return PairSummary(
        robots=robots,
        ranges=len(ranges),
        bearings=sum(bool(m.paths) for m in listed),
        first_ns=int(stamps_ns.min()),
        last_ns=int(stamps_ns.max()),
        interval_s=_quantile(gaps_s, 0.5),
        longest_gap_s=_quantile(gaps_s, 1),
        range_quantiles_m=(low, middle, high),
        sigma_m=_quantile(sigmas, 0.5),
    )


def _quantile(values: FloatArray, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else float("nan")
