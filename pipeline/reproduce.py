"""The paper's two experiments in simulated worlds like its own, beside the paper's tables row by row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from wiclosure.errors import ConfigError
from wiclosure.pipeline.comparison import Comparison, Outcome, Plan
from wiclosure.pipeline.comparison_figures import FIGURES, Figure, summaries
from wiclosure.pipeline.comparison_plan import scenario_worlds
from wiclosure.pipeline.comparison_tables import markdown, spread_text
from wiclosure.pipeline.metrics import Metrics
from wiclosure.pipeline.options import Configuration
from wiclosure.pipeline.statistics import spread
from wiclosure.simulation.names import lookup
from wiclosure.simulation.scenarios import ScenarioSettings

FILTERS = ("none", "wiclosure", "oracle")
FAILURE_DRIFTS, FAILURE_M = 2.0, 1.0
"""A run has failed where its robots are not all connected, or the team ATE exceeds so many times what odometry alone
leaves plus so many metres: more than drift explains."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """One of the paper's experiments.

    Args:
        title: of its table.
        scenario: name of the simulated world after it.
        site: preset of the site, or None.
        presets: the paper's back end, then ours.
        paper: the table's rows: label, baseline, with the filter.
        contradictions: what the paper says otherwise elsewhere.
        needs_poses: whether the world is built along a recorded trajectory.
    """

    title: str
    scenario: str
    site: str | None
    presets: tuple[str, str]
    paper: tuple[tuple[str, str, str], ...]
    contradictions: tuple[str, ...]
    needs_poses: bool = False


EXPERIMENTS: dict[str, Experiment] = {
    "kitti08": Experiment(
        title="Table I: simulation on KITTI 08",
        scenario="kitti08",
        site=None,
        presets=("disco-loose", "strong"),
        paper=(
            ("ATE (m)", "66.1", "1.3"),
            ("Correctly rejected false LC (%)", "N/A", "99"),
            ("Missed true LC (%)", "0", "1"),
            ("Total Computation Time (s)", "896", "411"),
            ("Total Wi-Closure time (s)", "N/A", "53"),
        ),
        contradictions=(
            "Missed true closures: 1 % in the table; the text says 1,913 of 5,544, which is 34.5 %.",
            "Rejected false closures: 99 % in the table; by the text 3,418 of 1,093,557 are kept, so 99.7 % rejected.",
            "Total time: 411 s in the table; the text says 464 s of which 53 s are Wi-Closure (411 s without it). The"
            " saving of 54 % is that of 411 s; with the filter's own time it is 48 %.",
            "ATE: the abstract says 99 % less; 66.1 m to 1.3 m is 98.0 %.",
            "Pairs: 1,099,101 here, but neither the keyframe distance, the cut of the sequence, the radio's range and"
            ' interval, nor the "worse set of parameters" is stated: disco-loose stands for the latter.',
        ),
        needs_poses=True,
    ),
    "shell-space": Experiment(
        title="Table II: hardware experiment in a shell space",
        scenario="shell-space",
        site="shell-space",
        presets=("disco-park", "strong"),
        paper=(
            ("ATE (m)", "17.6", "1.9"),
            ("Correctly rejected false LC (%)", "N/A", "78.7"),
            ("Missed true LC (%)", "0", "15"),
            ("Total Computation Time (s)", "155", "36"),
            ("Total Wi-Closure time (s)", "N/A", "0.5"),
        ),
        contradictions=(
            "Rejected false closures: 78.7 % in the table; by the text 1,848 candidates became 119, of which 115 are"
            " true. With 15 % of the true missed there were 135 true and 1,713 false, of which 4 are kept: 99.8 %.",
            "Pruned: the introduction says 78.7 % of the search space; 1,848 to 119 is 93.6 %.",
            "Gate, PCM threshold, and the radius within which a closure counts as true are not stated for this hall.",
        ),
    ),
}

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
    Figure("ATE of odometry alone, m", lambda m: m["ate_odometry_m"]["team"], None, "{:.3g}"),
    Figure("pairs", lambda m: m["pairs_total"], None, "{:,.0f}"),
    Figure("pairs kept", lambda m: m["pairs_kept"], None, "{:,.0f}"),
)


def plan_of(
    name: str,
    *,
    poses: Path | None = None,
    seed: int = 0,
    seeds: int = 1,
    n_scans: int | None = None,
    set_: list[str] | None = None,
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
    settings = Configuration(config=experiment.site, set_=set_)
    configs = {preset: settings.resolved(preset=preset) for preset in experiment.presets}
    worlds = scenario_worlds(experiment.scenario, ScenarioSettings(seed=seed, poses=poses), seeds, n_scans)
    return experiment, Plan(configs, FILTERS, worlds)


def table(experiment: Experiment, comparison: Comparison) -> tuple[list[str], list[list[str]]]:
    """Header and rows: the paper's two columns, then each of our arms; uncached seconds."""
    arms = list(comparison.arms.items())
    header = ["", "paper: baseline", "paper: Wi-Closure", *(f"{preset} {name}" for (preset, name), _ in arms)]
    rows = [[*said, *_cells(figure, comparison)] for said, figure in zip(experiment.paper, _ROWS, strict=True)]
    rows += [[figure.label, "", "", *_cells(figure, comparison)] for figure in _FURTHER]
    savings = [spread_text(arm.saving_percent, "{:.3g}") for arm in summaries(comparison)]
    return header, [*rows, ["saving of closing time, %", "", "", *savings]]


def verdicts(comparison: Comparison) -> list[str]:
    """In how many worlds each arm fails: where a baseline does not, it is said."""
    return [_verdict(preset, name, outcomes) for (preset, name), outcomes in comparison.arms.items()]


def report(experiment: Experiment, comparison: Comparison) -> str:
    """`reproduce.md`."""
    seeds = ", ".join(str(seed) for seed in dict.fromkeys(o.seed for o in comparison.outcomes))
    parts = [
        f"# {experiment.title}, reproduced",
        f"World: scenario `{experiment.scenario}`, seeds {seeds}. Medians over the seeds, [smallest, largest]; seconds"
        " are uncached: what each arm costs alone from raw scans, on this machine. The paper's figures are of its own"
        " robots and machine: compare its totals with each other.",
        markdown(*table(experiment, comparison)),
        "*Closing time* is search (filter and scan context), verification and optimisation. The oracle knows the true"
        " poses: a perfect filter. Odometry alone: each robot aligned on its own, what drift leaves.",
        "## What fails\n\nA run fails where its robots are not all connected, or its ATE is more than"
        f" {FAILURE_DRIFTS:g} times that of odometry alone plus {FAILURE_M:g} m.",
        _list(verdicts(comparison)),
        "## Where the paper contradicts itself",
        _list(experiment.contradictions),
    ]
    return "\n\n".join(parts) + "\n"


def _cells(figure: Figure, comparison: Comparison) -> list[str]:
    return [_cell(figure.value, outcomes, figure.form) for outcomes in comparison.arms.values()]


def _cell(value: Callable[[Metrics], float | None], outcomes: Sequence[Outcome], form: str) -> str:
    known = [found for found in (value(outcome.metrics) for outcome in outcomes) if found is not None]
    return spread_text(spread(known), form)


def _verdict(preset: str, name: str, outcomes: Sequence[Outcome]) -> str:
    failed = sum(_failed(o.metrics) for o in outcomes)
    false = sum(bool(o.metrics["closures"]["accepted_false"]) for o in outcomes)
    how = f"fails in {failed}" if failed else "does not fail in any"
    return f"{preset} with {name} {how} of {len(outcomes)} worlds; false closures are accepted in {false}."


def _failed(metrics: Metrics) -> bool:
    ate_m, drift_m = metrics["ate_m"]["team"], metrics["ate_odometry_m"]["team"]
    return ate_m is None or (drift_m is not None and ate_m > FAILURE_DRIFTS * drift_m + FAILURE_M)


def _list(sentences: Sequence[str]) -> str:
    return "\n".join(f"- {sentence}" for sentence in sentences)
