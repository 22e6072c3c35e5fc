"""Pictures of trajectories from above: each robot on its own, and merged by one arm or several."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wiclosure.colours import robot_colour
from wiclosure.display import significant
from wiclosure.pipeline.report.pictures import FAINT, FALSE, INK, new_figure, save
from wiclosure.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS_IN_A_ROW = 3
_APART_SHARE = 0.4  # of a panel's width, for robots that are not connected
_LEGEND_COLUMNS = 6


@dataclass(frozen=True, eq=False)
class MergedView:
    """What one arm made of the robots, from above; laid over ground truth by one alignment where there is some.

    Args:
        odometry: `(N, 2)` m, as recorded, by robot.
        paths: `(N, 2)` m, merged, by robot; those not connected to the first are missing, and drawn apart.
        truth: `(N, 2)` m, ground truth by robot.
        closures: `(K, 2, 2)` m, both ends of each accepted closure.
        false: `(K,)` which of them ground truth refutes.
        ate_m: of the team, or None.
    """

    odometry: Mapping[str, FloatArray]
    paths: Mapping[str, FloatArray]
    truth: Mapping[str, FloatArray]
    closures: FloatArray
    false: np.ndarray
    ate_m: float | None

    def colour(self, robot: str) -> str:
        """The same in every panel and in the map."""
        return robot_colour(list(self.odometry).index(robot))


def draw_run(path: Path, view: MergedView) -> None:
    """Left each robot in its own odometry frame, right all that are connected in one frame.

    Raises:
        OutputError: the picture cannot be written.
    """
    figure = new_figure(11.0, 5.2)
    before, after = figure.subplots(1, 2)
    _draw_own_frames(before, view, list(view.odometry))
    before.set_title("before\neach robot in its own frame", fontsize=11)
    _draw_view(after, "after", view)
    _finish(figure)
    before.set(xlabel="", ylabel="", xticks=[], yticks=[])
    save(figure, path)


def draw_merged(path: Path, views: Mapping[str, MergedView]) -> None:
    """One panel an arm, the base first: what the paper's figures 7 and 9 show.

    Raises:
        OutputError: the picture cannot be written.
    """
    columns = min(len(views), PANELS_IN_A_ROW)
    rows = -(-len(views) // columns)
    figure = new_figure(5.2 * columns, 4.9 * rows + 0.5)
    panels = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    for axes in panels[len(views) :]:
        axes.remove()
    for axes, (title, view) in zip(panels, views.items(), strict=False):
        _draw_view(axes, title, view)
    _finish(figure)
    save(figure, path)


def _draw_view(axes: Axes, title: str, view: MergedView) -> None:
    for robot, place in view.paths.items():
        _draw_path(axes, robot, place, view.colour(robot))
    for place in view.truth.values():
        axes.plot(*place.T, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label="ground truth", zorder=3)
    _draw_closures(axes, view.closures[~view.false], INK, ".", "accepted closure")
    _draw_closures(axes, view.closures[view.false], FALSE, "x", "accepted and false")
    error = "" if view.ate_m is None else f", ATE {significant(view.ate_m)} m"
    false = f", {view.false.sum()} of them false" if view.false.any() else ""
    axes.set_title(f"{title}\n{len(view.closures)} closures{false}{error}", fontsize=11)
    if apart := [robot for robot in view.odometry if robot not in view.paths]:
        _draw_apart(axes, view, apart)


def _draw_own_frames(axes: Axes, view: MergedView, robots: Sequence[str]) -> None:
    """Each robot's odometry from its own start, one beside the other: what nothing has brought together yet."""
    places = [view.odometry[robot] - view.odometry[robot].min(axis=0) for robot in robots]
    width_m, height_m = np.max([np.maximum(place.max(axis=0), 1.0) for place in places], axis=0)
    columns = _columns(len(robots), float(height_m / width_m))
    for n, (robot, place) in enumerate(zip(robots, places, strict=True)):
        row, column = divmod(n, columns)
        cell = np.array([1.2 * column * width_m, -1.2 * row * height_m])
        _draw_path(axes, robot, place + cell, view.colour(robot))
    _draw_scale(axes, width_m, -1.2 * ((len(robots) - 1) // columns) * height_m - 0.15 * height_m)


def _columns(robots: int, height_by_width: float) -> int:
    """How many robots stand in a row, so that all of them fill a panel, which is half as wide again as it is high."""
    return max(1, min(robots, round(math.sqrt(1.5 * robots * height_by_width))))


def _draw_scale(axes: Axes, width_m: float, y_m: float) -> None:
    """A bar of a round length: places in frames of their own have no coordinates in common."""
    length_m = 10.0 ** np.floor(np.log10(max(width_m, 1e-3)))
    length_m *= next(factor for factor in (5.0, 2.0, 1.0) if factor * length_m <= width_m or factor == 1.0)
    axes.plot([0.0, length_m], [y_m, y_m], color=INK, linewidth=2.0, solid_capstyle="butt")
    axes.annotate(f"{length_m:g} m", (length_m, y_m), (6, 0), textcoords="offset points", va="center", fontsize=10)


def _draw_apart(axes: Axes, view: MergedView, robots: Sequence[str]) -> None:
    """Robots that are not connected, in a box of their own beside the others: they have no place in their frame."""
    low, high = axes.get_xlim()
    axes.set_xlim(low, low + (high - low) / (1.0 - _APART_SHARE), auto=True)  # fixed ones oppose an equal aspect
    box = axes.inset_axes((1.0 - _APART_SHARE + 0.02, 0.02, _APART_SHARE - 0.04, 0.7), zorder=6)
    _draw_own_frames(box, view, robots)
    box.set(xticks=[], yticks=[], aspect="equal", facecolor="white")
    box.set_anchor("S")
    box.margins(0.15)
    title = textwrap.fill(f"not connected: {', '.join(robots)}", 18)
    box.set_title(title, fontsize=10, color=FALSE, pad=3)


def _draw_path(axes: Axes, robot: str, place: FloatArray, colour: str) -> None:
    axes.plot(*place.T, color=colour, linewidth=1.8, label=robot, solid_capstyle="round")
    axes.plot(*place[:1].T, marker="o", markersize=6, color=colour, markeredgecolor="white")
    axes.plot(*place[-1:].T, marker="s", markersize=5.5, color=colour, markeredgecolor="white")


def _draw_closures(axes: Axes, ends: FloatArray, colour: str, marker: str, label: str) -> None:
    from matplotlib.collections import LineCollection

    if len(ends):
        axes.add_collection(LineCollection(list(ends), colors=colour, linewidths=0.9, zorder=4))
        axes.plot(*ends.mean(axis=1).T, marker, color=colour, markersize=5, linestyle="", label=label, zorder=5)


def _finish(figure: Figure) -> None:
    """Axes alike, and one legend for what any panel shows."""
    from matplotlib.lines import Line2D

    found: dict[str, Artist] = {}
    for axes in figure.axes:
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m")
        axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
        axes.set_axisbelow(True)
        handles, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    for label, marker in (("start", "o"), ("end", "s")):
        found[label] = Line2D([], [], color=FAINT, marker=marker, linestyle="", markeredgecolor="white")
    columns = -(-len(found) // -(-len(found) // _LEGEND_COLUMNS))  # rows of about equal length
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=columns, frameon=False)
