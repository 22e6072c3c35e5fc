"""The paper's two experiments in simulated worlds like its own, beside the paper's tables row by row."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wiclosure.display import significant
from wiclosure.errors import ConfigError
from wiclosure.pipeline.comparison.experiments import EXPERIMENTS, Experiment
from wiclosure.pipeline.comparison.figures import FIGURES, Figure, summaries
from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.plan import Plan, scenario_worlds
from wiclosure.pipeline.comparison.statistics import spread_of
from wiclosure.pipeline.comparison.tables import markdown, spread_text
from wiclosure.pipeline.config import resolve
from wiclosure.pipeline.evaluation.metrics import Metrics
from wiclosure.simulation.names import lookup
from wiclosure.simulation.scenarios.registry import ScenarioSettings

ARMS = ("none", "wiclosure", "oracle")
"""Filters that run beside the paper's two columns."""

FAILURE_DRIFTS, FAILURE_M = 2.0, 1.0
"""A run has failed where its robots are not all connected, or the team ATE exceeds so many times what odometry alone
leaves plus so many metres: more than drift explains."""


_ROWS: tuple[Figure, ...] = (
    FIGURES["ate_m"],
    FIGURES["false_rejected_percent"],
    FIGURES["missed_percent"],
    FIGURES["total_s"],
    FIGURES["filter_s"],
)
"""Ours, in the order of the paper's tables."""

_FURTHER: tuple[Figure, ...] = (
    FIGURES["accepted_true"],
    FIGURES["accepted_false"],
    FIGURES["closing_s"],
    FIGURES["filter_share_percent"],
    Figure("ATE of odometry alone, m", lambda m: m["ate_odometry_m"]["team"], None, significant),
    Figure("pairs", lambda m: m["pairs_total"], None, "{:,.0f}".format),
    Figure("pairs kept", lambda m: m["pairs_kept"], None, "{:,.0f}".format),
)


def plan_of(
    name: str,
    *,
    poses: Path | None = None,
    seed: int = 0,
    seeds: int = 1,
    n_scans: int | None = None,
    set_: Sequence[str] | None = None,
) -> tuple[Experiment, Plan]:
    """The experiment of that name, and its arms.

    Args:
        name: a key of `EXPERIMENTS`.
        poses: KITTI poses file, for the experiment along a recorded trajectory.
        seed: of the first world.
        seeds: how many worlds.
        n_scans: read at most so many scans of each robot.
        set_: single settings, `key.path=value`.

    Raises:
        ConfigError: no such experiment, or poses missing or not needed.
    """
    experiment = lookup("experiment", name, EXPERIMENTS)
    if experiment.needs_poses != (poses is not None):
        raise ConfigError(
            f"reproduce {name} builds its streets along KITTI 08; name its poses with --poses FILE"
            if experiment.needs_poses
            else f"reproduce {name} takes no --poses; leave it out"
        )
    configs = {preset: resolve(experiment.site, set_, preset=preset) for preset in experiment.presets}
    worlds = scenario_worlds(experiment.scenario, ScenarioSettings(seed=seed, poses=poses), seeds, n_scans)
    return experiment, Plan(configs, ARMS, worlds)


def tables(experiment: Experiment, comparison: Comparison) -> dict[str, tuple[list[str], list[list[str]]]]:
    """Header and rows by back end: the paper's two columns, then each filter of ours; uncached seconds."""
    header = ["", "paper: baseline", "paper: filter", *(f"ours: {name}" for name in comparison.plan.filters)]
    return {preset: (header, _rows(experiment, comparison, preset)) for preset in experiment.presets}


def verdicts(comparison: Comparison) -> list[str]:
    """In how many worlds each arm fails: where a baseline does not, it is said."""
    return [_verdict(preset, name, outcomes) for (preset, name), outcomes in comparison.arms.items()]


def reproduction_report(experiment: Experiment, comparison: Comparison, n_scans: int | None = None) -> str:
    """`reproduce.md`; `n_scans` is how many of each robot's scans were read at most, if not all."""
    seeds = ", ".join(str(seed) for seed in dict.fromkeys(o.seed for o in comparison.outcomes))
    part_only = "" if n_scans is None else f" Read were the first {n_scans} scans of each robot: not the paper's drive."
    parts = [
        f"# {experiment.title}, reproduced",
        f"World: scenario `{experiment.scenario}`, seeds {seeds}. Medians over the seeds, [smallest, largest]; seconds"
        " are uncached: what each arm costs alone from raw scans, on this machine. The paper's figures are of its own"
        " robots and machine: compare its totals with each other." + part_only,
        *(
            f"## Back end {preset}\n\n{markdown(header, rows)}"
            for preset, (header, rows) in tables(experiment, comparison).items()
        ),
        "*Closing time* is search (filter and scan context), verification and optimisation. The oracle knows the true"
        " poses: a perfect filter. Odometry alone: each robot aligned on its own, what drift leaves.",
        "## What fails\n\nA run fails where its robots are not all connected, or its ATE is more than"
        f" {FAILURE_DRIFTS:g} times that of odometry alone plus {FAILURE_M:g} m.",
        _list(verdicts(comparison)),
        "## Where the paper contradicts itself",
        _list(experiment.contradictions),
    ]
    return "\n\n".join(parts) + "\n"


def _rows(experiment: Experiment, comparison: Comparison, preset: str) -> list[list[str]]:
    arms = [outcomes for (own, _), outcomes in comparison.arms.items() if own == preset]
    rows = [
        [*said, *(_cell(figure, outcomes) for outcomes in arms)]
        for said, figure in zip(experiment.paper, _ROWS, strict=True)
    ]
    rows += [[figure.label, "", "", *(_cell(figure, outcomes) for outcomes in arms)] for figure in _FURTHER]
    savings = [
        spread_text(arm.saving_percent, "{:.1f}".format) for arm in summaries(comparison) if arm.preset == preset
    ]
    return [*rows, ["saving of closing time, %", "", "", *savings]]


def _cell(figure: Figure, outcomes: Sequence[Outcome]) -> str:
    known = [value for value in (figure.value(outcome.metrics) for outcome in outcomes) if value is not None]
    return spread_text(spread_of(known), figure.form)


def _verdict(preset: str, name: str, outcomes: Sequence[Outcome]) -> str:
    failed = sum(_failed(o.metrics) for o in outcomes)
    false = sum(bool(o.metrics["closures"]["accepted_false"]) for o in outcomes)
    how = f"fails in {failed} of {len(outcomes)} worlds" if failed else f"does not fail (0 of {len(outcomes)} worlds)"
    return f"{preset} with {name} {how}; false closures are accepted in {false}."


def _failed(metrics: Metrics) -> bool:
    ate_m, drift_m = metrics["ate_m"]["team"], metrics["ate_odometry_m"]["team"]
    return ate_m is None or (drift_m is not None and ate_m > FAILURE_DRIFTS * drift_m + FAILURE_M)


def _list(sentences: Sequence[str]) -> str:
    return "\n".join(f"- {sentence}" for sentence in sentences)
