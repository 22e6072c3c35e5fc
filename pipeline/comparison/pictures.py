"""Pictures of a comparison: errors of all arms and seeds, and the candidate funnel.

Colours are Okabe and Ito's; what colour says is also said by marker, line or place.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wiclosure.pipeline.evaluation.funnel import STAGES
from wiclosure.pipeline.report.pictures import FAINT, FALSE, INK, TRUE, new_figure, save
from wiclosure.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome

FILTER_STYLES = {
    "none": ("#555555", "o"),
    "wiclosure": ("#0072b2", "s"),
    "range-gate": ("#e69f00", "^"),
    "oracle": ("#009e73", "D"),
    "random": ("#cc79a7", "v"),
}
ZERO = 0.25
"""Where nothing is drawn on a logarithmic axis that counts."""


def draw_errors(path: Path, comparison: Comparison) -> None:
    """Team ATE of every arm, one point per seed, on a logarithmic axis.

    Raises:
        OutputError: the picture cannot be written.
    """
    arms = comparison.arms
    figure = new_figure(8.5, 1.5 + 0.3 * len(arms))
    axes = figure.subplots()
    _draw_odometry(axes, comparison.outcomes)
    for row, ((_, name), outcomes) in enumerate(arms.items()):
        colour, marker = FILTER_STYLES[name]
        errors = np.array([o.metrics["ate_m"]["team"] or np.nan for o in outcomes])
        places = row + _spread_out(len(errors))
        axes.plot(errors, places, marker, color=colour, markersize=5, markeredgewidth=0, clip_on=False)
        if len(errors) > 1 and np.isfinite(errors).all():
            axes.plot([np.median(errors)] * 2, [row - 0.36, row + 0.36], color=colour, linewidth=2.2)
        if lost := int(np.isnan(errors).sum()):
            text = "not connected" if lost == len(errors) == 1 else f"{lost} of {len(errors)} not connected"
            axes.text(1.01, row, text, transform=axes.get_yaxis_transform(), va="center", fontsize=8, color=INK)
    _scale_errors(axes)
    _label_arms(axes, list(arms))
    axes.set_xlabel("team ATE, m (one point per seed, line: median)")
    axes.grid(visible=True, axis="x", color="#ececec", linewidth=0.6)
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower center", frameon=False, fontsize=8)
    axes.set_axisbelow(True)
    save(figure, path)


def draw_funnel(path: Path, comparison: Comparison) -> None:
    """Candidates that are left after each stage, one panel per arm: median over the seeds, and from least to most.

    Raises:
        OutputError: the picture cannot be written.
    """
    presets, filters = list(comparison.plan.configs), comparison.plan.filters
    figure = new_figure(0.8 + 2.4 * max(len(filters), 2), 1.5 + 1.9 * len(presets))
    grid = np.array(figure.subplots(len(presets), len(filters), sharex=True, sharey=True, squeeze=False))
    for (preset, name), outcomes in comparison.arms.items():
        axes = grid[presets.index(preset), filters.index(name)]
        _draw_stages(axes, outcomes)
        axes.set_title(f"{name}: {_in_graph(outcomes)}", fontsize=9)
    for axes, preset in zip(grid[:, 0], presets, strict=True):
        axes.set_ylabel(preset if len(presets) > 1 else "candidates", fontsize=9)
    for axes in grid[-1]:
        axes.set_xticks(range(len(STAGES)), STAGES, rotation=40, ha="right", fontsize=8)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    save(figure, path)


# -------------------------------------------------------------------------------------------------------------- errors
def _spread_out(count: int) -> FloatArray:
    """Places around 0 for the points of one row."""
    return np.linspace(-0.22, 0.22, count) if count > 1 else np.zeros(1)


def _draw_odometry(axes: Axes, outcomes: Sequence[Outcome]) -> None:
    """What drift alone leaves, as a band over the seeds."""
    alone = [e for e in (o.metrics["ate_odometry_m"]["team"] for o in outcomes) if e]
    if alone:
        label = "odometry alone, each robot aligned on its own"
        axes.axvspan(min(alone) * 0.98, max(alone) * 1.02, color="#dddddd", linewidth=0, label=label)


def _scale_errors(axes: Axes) -> None:
    """A logarithmic axis of one decade at least, with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axes.set_xscale("log")
    low, high = axes.get_xlim()
    grow = max(1.2, np.sqrt(10 * low / high))
    axes.set_xlim(low / grow, high * grow)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 1000 else (1.0,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_locator(NullLocator())


def _label_arms(axes: Axes, arms: Sequence[tuple[str, str]]) -> None:
    """Filters beside their rows; presets, where there are several, before them, with a line between."""
    axes.set_yticks(range(len(arms)), [name for _, name in arms], fontsize=9)
    axes.set_ylim(len(arms) - 0.4, -0.6)
    presets = list(dict.fromkeys(preset for preset, _ in arms))
    if len(presets) == 1:
        return
    for preset in presets:
        rows = [row for row, (own, _) in enumerate(arms) if own == preset]
        axes.text(
            -0.17, float(np.mean(rows)), preset, transform=axes.get_yaxis_transform(), fontsize=9, color=INK,
            fontweight="bold", va="center", ha="right",
        )  # fmt: skip
        if rows[0]:
            axes.axhline(rows[0] - 0.5, xmin=-0.17, color=FAINT, linewidth=0.6, clip_on=False)


# -------------------------------------------------------------------------------------------------------------- funnel
def _draw_stages(axes: Axes, outcomes: Sequence[Outcome]) -> None:
    counts = [[(s["true"], s["false"], s["count"]) for s in o.metrics["funnel"]] for o in outcomes]
    known = all(None not in (true, false) for run in counts for true, false, _ in run)
    numbers = np.array([[[n or 0 for n in stage] for stage in run] for run in counts], float)
    lines = [(0, TRUE, "o", "-", "true"), (1, FALSE, "x", "--", "false")] if known else [(2, INK, "o", "-", "all")]
    for column, colour, marker, style, label in lines:
        shown = np.maximum(numbers[:, :, column], ZERO)
        stages = np.arange(shown.shape[1])
        axes.fill_between(stages, shown.min(axis=0), shown.max(axis=0), color=colour, alpha=0.15, linewidth=0)
        middle = np.median(shown, axis=0)
        axes.plot(
            stages, middle, color=colour, marker=marker, linestyle=style, linewidth=1.4, markersize=4.5, label=label
        )
    axes.axvline(2.5, color="#cccccc", linewidth=0.8)
    axes.set_yscale("log")
    top = int(np.ceil(np.log10(max(numbers.max(), 10))))
    ticks = 10.0 ** np.arange(0, top + 1, 2 if top > 4 else 1)
    axes.set_yticks([ZERO, *ticks], ["0", *(_short(int(n)) for n in ticks)], fontsize=8)
    axes.minorticks_off()
    axes.set_ylim(ZERO * 0.8, None)
    axes.grid(visible=True, axis="y", color="#ececec", linewidth=0.6)


def _in_graph(outcomes: Sequence[Outcome]) -> str:
    last = [o.metrics["funnel"][-1] for o in outcomes]
    true, false = [s["true"] for s in last], [s["false"] for s in last]
    if None in true or None in false:
        return f"{np.median([s['count'] for s in last]):g} accepted"
    return f"{np.median(np.array(true, float)):g} true, {np.median(np.array(false, float)):g} false"


def _short(count: int) -> str:
    for limit, unit in ((1_000_000, "M"), (1_000, "k")):
        if count >= limit:
            return f"{count / limit:.3g}{unit}"
    return str(count)
