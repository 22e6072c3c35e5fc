"""The figures by which arms are compared, and their statistics over all seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from wiclosure.display import significant
from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.statistics import Better, Paired, Spread, paired, spread_of
from wiclosure.pipeline.evaluation.metrics import Metrics

CLOSING = ("filter", "matching", "verification", "optimisation")
"""Stages that find closures between robots and use them: search (filter and matching), verification, optimisation."""


def closing_seconds(seconds: Mapping[str, float]) -> float:
    """Search, verification and optimisation as one figure; the filter is part of the search."""
    return sum(seconds[stage] for stage in CLOSING)


def saving_percent(metrics: Metrics, base: Metrics) -> float | None:
    """How much less time search, verification and optimisation take than with the base arm, uncached.

    None where either found no closure: doing less and finding nothing saves nothing.
    """
    if not (metrics["closures"]["accepted"] and base["closures"]["accepted"]):
        return None
    return 100 * (1 - closing_seconds(metrics["seconds"]) / closing_seconds(base["seconds"]))


def filter_share_percent(metrics: Metrics) -> float:
    """Share of the filter in the whole run, uncached."""
    return 100 * metrics["seconds"]["filter"] / metrics["seconds"]["total"]


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a run.

    Args:
        label: for tables.
        value: None where it is not known, infinite where the run failed.
        better: which direction is good; None: neither, no arms are compared by it.
        form: how it is printed.
    """

    label: str
    value: Callable[[Metrics], float | None]
    better: Better | None
    form: Callable[[float], str]


def _ate(metrics: Metrics) -> float | None:
    ate_m = metrics["ate_m"]["team"]
    unconnected = ate_m is None and metrics["ate_odometry_m"]["team"] is not None
    return math.inf if unconnected else ate_m


def _missed(metrics: Metrics) -> float | None:
    recall = metrics["candidates"]["recall"]
    return None if recall is None else 100 * (1 - recall)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


FIGURES: dict[str, Figure] = {
    "ate_m": Figure("ATE, m", _ate, "low", significant),
    "accepted_true": Figure("true closures", lambda m: m["closures"]["accepted_true"], "high", "{:.4g}".format),
    "accepted_false": Figure("false closures", lambda m: m["closures"]["accepted_false"], "low", "{:.4g}".format),
    "missed_percent": Figure("missed true, %", _missed, "low", "{:.1f}".format),
    "false_rejected_percent": Figure(
        "rejected false, %", lambda m: _percent(m["candidates"]["false_rejected"]), None, "{:.1f}".format
    ),
    "pairs_kept": Figure("pairs kept", lambda m: m["pairs_kept"], None, "{:,.0f}".format),
    "proposed": Figure("proposed", lambda m: m["closures"]["proposed"], None, "{:,.5g}".format),
    "accepted": Figure("accepted", lambda m: m["closures"]["accepted"], None, "{:.4g}".format),
    "connected": Figure("robots connected", lambda m: len(m["components"][0]["robots"]), "high", "{:.4g}".format),
    "closing_s": Figure("closing time, s", lambda m: closing_seconds(m["seconds"]), "low", significant),
    "filter_s": Figure("filter, s", lambda m: m["seconds"]["filter"], None, "{:.2f}".format),
    "filter_share_percent": Figure("filter, % of run", filter_share_percent, None, "{:.2f}".format),
    "total_s": Figure("total, s", lambda m: m["seconds"]["total"], "low", "{:.1f}".format),
}


@dataclass(frozen=True, eq=False)
class ArmSummary:
    """An arm over all its seeds.

    Args:
        preset, filter: the arm.
        runs: how many.
        figures: spread of each of `FIGURES` that is known.
        saving_percent: of search, verification and optimisation against the base arm, seed by seed; None for the base.
        against_base: comparison of each figure that has a better direction; empty for the base.
        seconds: median of each stage, uncached.
        seconds_spent: median of each stage as really spent.
    """

    preset: str
    filter: str
    runs: int
    figures: dict[str, Spread]
    saving_percent: Spread | None
    against_base: dict[str, Paired]
    seconds: dict[str, float]
    seconds_spent: dict[str, float]


def summaries(comparison: Comparison) -> list[ArmSummary]:
    """One for each arm, in order."""
    return [
        _summary(preset, name, outcomes, comparison.base(preset))
        for (preset, name), outcomes in comparison.arms.items()
    ]


def _summary(preset: str, name: str, outcomes: Sequence[Outcome], base: Sequence[Outcome]) -> ArmSummary:
    is_base = outcomes == base
    base_of = {o.seed: o.metrics for o in base}
    compared_to = [(o.metrics, base_of[o.seed]) for o in outcomes if o.seed in base_of]
    savings = [saved for own, of_base in compared_to if (saved := saving_percent(own, of_base)) is not None]
    spreads = {key: spread_of(list(_values(figure, outcomes).values())) for key, figure in FIGURES.items()}
    compared = {
        key: paired(_values(figure, outcomes), _values(figure, base), figure.better)
        for key, figure in FIGURES.items()
        if figure.better is not None and not is_base
    }
    return ArmSummary(
        preset=preset,
        filter=name,
        runs=len(outcomes),
        figures={key: found for key, found in spreads.items() if found is not None},
        saving_percent=None if is_base else spread_of(savings),
        against_base={key: found for key, found in compared.items() if found.pairs},
        seconds=_medians([o.metrics["seconds"] for o in outcomes]),
        seconds_spent=_medians([o.metrics["seconds_spent"] for o in outcomes]),
    )


def _values(figure: Figure, outcomes: Sequence[Outcome]) -> dict[int, float]:
    """By seed, where known."""
    found = {outcome.seed: figure.value(outcome.metrics) for outcome in outcomes}
    return {seed: value for seed, value in found.items() if value is not None}


def _medians(runs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    found = {stage: spread_of([run[stage] for run in runs]) for stage in runs[0]}
    return {stage: spread_s.median for stage, spread_s in found.items() if spread_s is not None}
