"""Which candidates a filter left, as a picture; and what all pictures share.

Drawn without a display and without global state.  Colours are Okabe and Ito's, told apart with every kind of colour
vision; what colour says is also said by shape or by place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wiclosure.errors import OutputError
from wiclosure.pipeline.evaluation.errors import truth_at
from wiclosure.types import CandidatePairs, Closure, FloatArray, Stage, Trajectory, survivors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure


INK, FAINT = "#222222", "#9a9a9a"
MISSED, WASTED, FOUND = "#f2b48c", "#c9d3da", "#0072b2"  # true but not kept, kept but false, true and kept
TRUE, FALSE = "#0072b2", "#d55e00"
DPI = 190
_SHRINK = 0.79  # figures are laid out larger than they are drawn: letters stay readable at half the pixels


def draw_candidates(
    path: Path,
    arms: Mapping[str, CandidatePairs],
    *,
    keyframes: Mapping[str, Trajectory],
    closures: Mapping[str, Sequence[Closure]],
    truth: Mapping[str, Trajectory],
    radius_m: float,
    gap_s: float = 1.0,
) -> None:
    """The matrix of keyframe pairs of two robots, one panel for each filter.

    Args:
        path: PNG to write.
        arms: kept pairs of the same two robots, by the title of the panel.
        keyframes: by robot, for stamps and counts.
        closures: by the same titles; accepted ones are marked.
        truth: ground truth by robot; without it only kept and not kept are told apart.
        radius_m: distance within which a pair is true.
        gap_s: how near ground truth must be in time.

    Raises:
        OutputError: the picture cannot be written.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    first = next(iter(arms.values()))
    a, b = first.robot_a, first.robot_b
    near = _near(keyframes[a], keyframes[b], truth, radius_m, gap_s)
    figure = new_figure(0.6 + (4.4 if len(arms) <= 3 else 3.4) * len(arms), 4.9)
    for axes, (title, pairs) in zip(
        np.atleast_1d(figure.subplots(1, len(arms), sharey=True)), arms.items(), strict=True
    ):
        kept = np.zeros((len(keyframes[a]), len(keyframes[b])), bool)
        kept[pairs.index_a, pairs.index_b] = True
        axes.imshow(_matrix_colours(near, kept), origin="lower", aspect="auto", interpolation="antialiased")
        marks = _accepted_cells(closures.get(title, ()), a, b)
        axes.scatter(marks[:, 1], marks[:, 0], s=26, marker="x", color=FALSE, linewidths=1.3)
        axes.set_title(f"{title}\n{len(pairs):,} of {kept.size:,} pairs", fontsize=12 if len(arms) <= 3 else 9.5)
        axes.set_xlabel(f"keyframe of {b}")
        axes.tick_params(length=2)
    figure.axes[0].set_ylabel(f"keyframe of {a}")
    handles: list[Artist] = [
        Patch(color=FOUND, label=f"kept, within {radius_m:g} m"),
        Patch(color=WASTED, label="kept, further apart"),
    ]
    if near.any():
        handles.append(Patch(color=MISSED, label=f"not kept, within {radius_m:g} m"))
    handles.append(Line2D([], [], color=FALSE, marker="x", linestyle="", label="accepted closure"))
    columns = 4 if len(arms) > 2 else 2  # what fits the width
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    save(figure, path)


def _near(a: Trajectory, b: Trajectory, truth: Mapping[str, Trajectory], radius_m: float, gap_s: float) -> np.ndarray:
    """`(N, M)`: pairs within the radius, by ground truth."""
    (poses_a, covered_a), (poses_b, covered_b) = (truth_at(truth.get(t.robot), t.stamps_ns, gap_s) for t in (a, b))
    position_a, position_b = poses_a[:, :3, 3], poses_b[:, :3, 3]
    # |a - b|^2 = |a|^2 + |b|^2 - 2 a b: no (N, M, 3) array for thousands of keyframes
    squared = (position_a**2).sum(axis=1)[:, None] + (position_b**2).sum(axis=1) - 2 * position_a @ position_b.T
    return np.asarray((squared <= radius_m**2) & covered_a[:, None] & covered_b)


def _matrix_colours(near: np.ndarray, kept: np.ndarray) -> np.ndarray:
    from matplotlib.colors import to_rgb

    palette = np.array([to_rgb(c) for c in ("white", WASTED, MISSED, FOUND)])
    return np.asarray(palette[kept + 2 * near.astype(int)])


def _accepted_cells(closures: Sequence[Closure], robot_a: str, robot_b: str) -> FloatArray:
    """Row and column `(K, 2)` of the accepted closures of two robots."""
    cells = [
        {c.query.robot: c.query.index, c.match.robot: c.match.index}
        for c in survivors(closures, Stage.ESTIMATE)
        if {c.query.robot, c.match.robot} == {robot_a, robot_b}
    ]
    return np.array([[cell[robot_a], cell[robot_b]] for cell in cells], float).reshape(-1, 2)


# -------------------------------------------------------------------------------------------------------------- common
def new_figure(width: float, height: float) -> Figure:
    """An empty figure of so many inches, as laid out; it is drawn smaller, with as many pixels."""
    from matplotlib.figure import Figure

    return Figure(figsize=(_SHRINK * width, _SHRINK * height), layout="constrained", facecolor="white")


def save(figure: Figure, path: Path) -> None:
    """Writes a figure.

    Raises:
        OutputError: it cannot be written.
    """
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
        for text in (axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts):
            text.set_parse_math(False)  # names from recordings are no formulas
    for legend in figure.legends:
        for text in legend.get_texts():
            text.set_parse_math(False)
    try:
        figure.savefig(path, dpi=DPI)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error
