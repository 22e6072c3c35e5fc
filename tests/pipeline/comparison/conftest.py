"""Comparisons as they come out of runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeAlias

import pytest

from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.plan import Plan
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.evaluation.funnel import STAGES
from wiclosure.pipeline.report import pictures

Compared: TypeAlias = Callable[..., Comparison]


def metrics_of(ate_m: float | None, seconds: float, false: int = 0) -> dict:
    """`metrics.json` as far as comparisons read it."""
    stages = dict.fromkeys(("odometry", "descriptors", "filter", "matching", "verification", "optimisation"), seconds)
    found = {"precision": 0.5, "recall": 0.9, "false_rejected": 0.75, "pruned": 0.7}
    return {
        "ate_m": {"team": ate_m},
        "ate_horizontal_m": {"team": ate_m},
        "ate_odometry_m": {"team": 0.25},
        "components": [{"robots": ["alpha", "beta"], "ate_m": ate_m}],
        "candidates": found,
        "candidates_registrable": found,
        "pairs_kept": 90,
        "closures": {"proposed": 20, "accepted": 8 + false, "accepted_true": 8, "accepted_false": false},
        "starts": {},
        "funnel": [{"stage": stage, "count": 9, "true": 8, "false": 1} for stage in STAGES],
        "seconds": stages | {"mapping": 0.0, "total": 6 * seconds},
        "seconds_spent": stages | {"odometry": 0.0, "mapping": 0.0, "total": 5 * seconds},
        "bytes_exchanged": 1000,
        "peak_rss_mb": None,
    }


def _comparison_of(value: Callable[[str, int], dict], seeds: int = 6) -> Comparison:
    plan = Plan({"strong": Config(), "loose": Config()}, ("none", "wiclosure"), ())
    outcomes = tuple(
        Outcome(seed, preset, name, Path(f"seed-{seed}", preset, name), value(name, seed))
        for preset in plan.configs
        for name in plan.filters
        for seed in range(seeds)
    )
    return Comparison(plan, outcomes)


@pytest.fixture(scope="module")
def coarse() -> Iterator[None]:
    """Pictures of few pixels, for speed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pictures, "DPI", 40)
        yield


@pytest.fixture
def run_metrics() -> Callable[..., dict]:
    """`metrics.json` of team ATE, seconds of every stage and false closures, as far as comparisons read it."""
    return metrics_of


@pytest.fixture
def comparison_of() -> Compared:
    """Two presets with two filters, from the metrics of filter and seed."""
    return _comparison_of


@pytest.fixture
def repeated() -> Comparison:
    """Six worlds in which the filter halves the time, and connects robots that are lost without it in world 0."""
    alone = [None, 10.0, 11.0, 12.0, 13.0, 14.0]
    return _comparison_of(
        lambda name, n: metrics_of(0.5, 1.0) if name == "wiclosure" else metrics_of(alone[n], 2.0, false=3)
    )
