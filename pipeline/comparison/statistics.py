"""Statistics over repeated runs: spread, and arms compared seed by seed.

An infinite value stands for a run that failed, such as robots that stayed unconnected: worse than any number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

Better = Literal["low", "high"]

FEWEST_PAIRS = 5
"""Of fewer, even if all agree, p is 0.125 or more.  Of five it is 0.0625 at best, of six 0.03."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Median, smallest and largest of a figure over runs; infinite where those runs failed."""

    runs: int
    median: float
    smallest: float
    largest: float


@dataclass(frozen=True, slots=True)
class Paired:
    """An arm against the base arm, world by world.

    Args:
        pairs: worlds that both have.
        better: worlds in which the arm is better than the base.
        worse: worlds in which it is worse.
        median_difference: of arm minus base, over the pairs in which neither failed; None without any.
        p: of a two-sided test that the arms differ by chance alone; None of fewer than `FEWEST_PAIRS` pairs, or where
            all are equal.
        test: which test gave `p`, or why there is none.
    """

    pairs: int
    better: int
    worse: int
    median_difference: float | None
    p: float | None
    test: str


def spread_of(values: list[float]) -> Spread | None:
    """Of one value per run; None without any."""
    if not values:
        return None
    ordered = sorted(values)
    median = (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
    return Spread(len(values), median, ordered[0], ordered[-1])


def paired(arm: Mapping[int, float], base: Mapping[int, float], better: Better) -> Paired:
    """Compares two arms over the worlds (seeds) that both have.

    Wilcoxon's signed-rank test; a sign test where a run failed, since a failure has no size.

    Args:
        arm: value by seed.
        base: the same of the arm to compare with.
        better: whether low or high values are good.
    """
    seeds = [seed for seed in arm if seed in base]
    sign = -1.0 if better == "low" else 1.0
    gains = np.array([sign * _difference(arm[seed], base[seed]) for seed in seeds])
    finite = [_difference(arm[s], base[s]) for s in seeds if math.isfinite(arm[s]) and math.isfinite(base[s])]
    p, test = _test(gains)
    return Paired(
        pairs=len(seeds),
        better=int((gains > 0).sum()),
        worse=int((gains < 0).sum()),
        median_difference=float(np.median(finite)) if finite else None,
        p=p,
        test=test,
    )


def _difference(value: float, base: float) -> float:
    """Zero where only rounding differs; two failures are equal."""
    return 0.0 if math.isclose(value, base, rel_tol=1e-6) else value - base


def _test(gains: np.ndarray) -> tuple[float | None, str]:
    from scipy import stats

    if len(gains) < FEWEST_PAIRS:
        return None, f"{len(gains)} of the {FEWEST_PAIRS} seeds needed for a test"
    unequal = gains[gains != 0]
    if not len(unequal):
        return None, "all seeds equal"
    if np.isfinite(unequal).all():
        # Exact for few pairs, by itself also where differences tie.
        return float(stats.wilcoxon(unequal, method="auto").pvalue), "Wilcoxon signed-rank"
    return float(stats.binomtest(int((unequal > 0).sum()), len(unequal)).pvalue), "sign test"
