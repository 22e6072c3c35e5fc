"""Pictures of trajectories from above: each robot on its own, and merged by one arm or several."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wiclosure.colours import robot_colour
from wiclosure.pipeline.report.pictures import FAINT, FALSE, INK, new_figure, save
from wiclosure.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS_IN_A_ROW = 3


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
    before.set_xlabel("m, from each start")
    before.set_ylabel("")
    before.set_yticks([])
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
    error = "" if view.ate_m is None else ", ATE " + f"{view.ate_m:#.3g}".rstrip(".") + " m"
    false = f", {view.false.sum()} of them false" if view.false.any() else ""
    axes.set_title(f"{title}\n{len(view.closures)} closures{false}{error}", fontsize=11)
    if apart := [robot for robot in view.odometry if robot not in view.paths]:
        _draw_apart(axes, view, apart)


def _draw_own_frames(axes: Axes, view: MergedView, robots: Sequence[str]) -> None:
    """Each robot's odometry from its own start, one below the other: what nothing has brought together yet."""
    below_m = 0.0
    for robot in robots:
        place = view.odometry[robot] - view.odometry[robot][0]
        height_m = max(float(np.ptp(place[:, 1])), 0.1 * float(np.ptp(place[:, 0])), 1.0)
        _draw_path(axes, robot, place + np.array([0.0, below_m - place[:, 1].max()]), view.colour(robot))
        below_m -= 1.15 * height_m


def _draw_apart(axes: Axes, view: MergedView, robots: Sequence[str]) -> None:
    """Robots that are not connected, in a box of their own: they have no place in the others' frame."""
    box = axes.inset_axes((0.6, 0.02, 0.38, 0.4), zorder=6)
    _draw_own_frames(box, view, robots)
    box.set(xticks=[], yticks=[], aspect="equal", facecolor="#ffffffe0")
    box.margins(0.15)
    title = textwrap.fill(f"not connected: {', '.join(robots)}", 20)
    box.set_title(title, fontsize=9, color=FALSE, pad=3)


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
    columns = min(len(found), 6)
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=columns, frameon=False)
