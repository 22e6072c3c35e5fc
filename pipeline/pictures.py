"""Pictures of a run: trajectories before and after merging, and which candidates the filter left.

Drawn without a display and without global state.  Colours are Okabe and Ito's, told apart with every kind of colour
vision; what colour says is also said by shape or by place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wiclosure import se3
from wiclosure.backends.merged_map import ROBOT_COLOURS
from wiclosure.errors import OutputError
from wiclosure.pipeline.trajectory_error import matched, rigid_alignment, truth_at
from wiclosure.types import CandidatePairs, Closure, Decision, FloatArray, Trajectory

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


INK, FAINT = "#222222", "#9a9a9a"
MISSED, WASTED, FOUND = "#f2b48c", "#c9d3da", "#0072b2"  # true but not kept, kept but false, true and kept
CLOSURE = "#d55e00"
DPI = 150


def draw_trajectories(
    path: Path,
    *,
    odometry: Mapping[str, Trajectory],
    merged: Mapping[str, Trajectory],
    keyframes: Mapping[str, Trajectory],
    closures: Sequence[Closure],
    components: Sequence[Sequence[str]],
    truth: Mapping[str, Trajectory],
    gap_s: float = 1.0,
) -> None:
    """Top view: left each robot in its own odometry frame, right all that are connected in one frame.

    Args:
        path: PNG to write.
        odometry: as recorded, by robot.
        merged: `T_world_body` by robot.
        keyframes: merged keyframes by robot, between which accepted closures are drawn.
        closures: all; accepted ones are drawn.
        components: robots that closures connect; those outside the first are named as not connected.
        truth: ground truth by robot, drawn thin where there is some.
        gap_s: how near ground truth must be in time.

    Raises:
        OutputError: the picture cannot be written.
    """
    figure = new_figure(11.0, 5.2)
    before, after = figure.subplots(1, 2)
    connected = set(components[0])
    accepted = [c for c in closures if c.decision is Decision.ACCEPTED and c.query.robot in connected]
    _draw_truth(after, {r: merged[r] for r in merged if r in connected}, truth, gap_s)
    for axes, trajectories in ((before, odometry), (after, merged)):
        for robot, trajectory in trajectories.items():
            if axes is before or robot in connected:
                _draw_path(axes, trajectory, robot_colour(list(odometry).index(robot)))
    ends = [[keyframes[k.robot].positions[k.index, :2] for k in (c.query, c.match)] for c in accepted]
    _draw_closures(after, np.array(ends).reshape(-1, 2, 2))
    before.set_title("before: each robot in its own frame")
    after.set_title(f"after: one frame, {len(accepted)} closures")
    outside = [robot for robot in merged if robot not in connected]
    if outside:
        note = f"not connected: {', '.join(outside)}"
        after.text(0.02, 0.02, note, transform=after.transAxes, color=INK, va="bottom")
    _legend(figure, (before, after))
    save(figure, path)


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
        axes.scatter(marks[:, 1], marks[:, 0], s=26, marker="x", color=CLOSURE, linewidths=1.3)
        axes.set_title(f"{title}: {len(pairs):,} of {kept.size:,} pairs", fontsize=12 if len(arms) <= 3 else 9.5)
        axes.set_xlabel(f"keyframe of {b}")
        axes.tick_params(length=2)
    figure.axes[0].set_ylabel(f"keyframe of {a}")
    handles: list[Artist] = [
        Patch(color=FOUND, label=f"kept, within {radius_m:g} m"),
        Patch(color=WASTED, label="kept, further apart"),
    ]
    if near.any():
        handles.append(Patch(color=MISSED, label=f"not kept, within {radius_m:g} m"))
    handles.append(Line2D([], [], color=CLOSURE, marker="x", linestyle="", label="accepted closure"))
    columns = 4 if len(arms) > 1 else 2  # what fits the width
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
    save(figure, path)


# ------------------------------------------------------------------------------------------------------- trajectories
def _draw_path(axes: Axes, trajectory: Trajectory, colour: str) -> None:
    x, y = trajectory.positions[:, 0], trajectory.positions[:, 1]
    axes.plot(x, y, color=colour, linewidth=1.8, label=trajectory.robot, solid_capstyle="round")
    axes.plot(x[:1], y[:1], marker="o", markersize=6, color=colour, markeredgecolor="white")
    axes.plot(x[-1:], y[-1:], marker="s", markersize=5.5, color=colour, markeredgecolor="white")


def _draw_truth(axes: Axes, merged: Mapping[str, Trajectory], truth: Mapping[str, Trajectory], gap_s: float) -> None:
    """Ground truth of the connected robots, laid over the estimate by one alignment."""
    found = {robot: matched(trajectory, truth.get(robot), gap_s) for robot, trajectory in merged.items()}
    covered = [m for m in found.values() if len(m)]
    if not covered:
        return
    estimate = np.concatenate([m.estimate[:, :3, 3] for m in covered])
    true = np.concatenate([m.truth[:, :3, 3] for m in covered])
    T_estimate_truth = se3.inverse(rigid_alignment(estimate, true))
    for n, m in enumerate(covered):
        place = (T_estimate_truth @ m.truth)[:, :2, 3]
        label = "ground truth" if n == 0 else None
        axes.plot(place[:, 0], place[:, 1], color=INK, linewidth=0.8, linestyle=(0, (4, 2)), label=label, zorder=3)


def _draw_closures(axes: Axes, ends: FloatArray) -> None:
    from matplotlib.collections import LineCollection

    if len(ends):
        axes.add_collection(LineCollection(list(ends), colors=CLOSURE, linewidths=0.9, zorder=4))
        middle = ends.mean(axis=1)
        axes.scatter(middle[:, 0], middle[:, 1], s=9, color=CLOSURE, zorder=5, linewidths=0, label="closure")


def _legend(figure: Figure, panels: Sequence[Axes]) -> None:
    from matplotlib.lines import Line2D

    found: dict[str, Artist] = {}
    for axes in panels:
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m")
        axes.grid(visible=True, color="#e6e6e6", linewidth=0.6)
        axes.set_axisbelow(True)
        handles, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, handles, strict=True))
    for label, marker in (("start", "o"), ("end", "s")):
        found[label] = Line2D([], [], color=FAINT, marker=marker, linestyle="", markeredgecolor="white")
    figure.legend(list(found.values()), list(found), loc="outside lower center", ncols=len(found), frameon=False)


# --------------------------------------------------------------------------------------------------------- candidates
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
        for c in closures
        if c.decision is Decision.ACCEPTED and {c.query.robot, c.match.robot} == {robot_a, robot_b}
    ]
    return np.array([[cell[robot_a], cell[robot_b]] for cell in cells], float).reshape(-1, 2)


# -------------------------------------------------------------------------------------------------------------- common
def robot_colour(number: int) -> str:
    """Colour of the robot of that number, as in the map."""
    red, green, blue = ROBOT_COLOURS[number % len(ROBOT_COLOURS)]
    return f"#{red:02x}{green:02x}{blue:02x}"


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def save(figure: Figure, path: Path) -> None:
    """Writes a figure.

    Raises:
        OutputError: it cannot be written.
    """
    for axes in figure.axes:
        axes.spines[["top", "right"]].set_visible(False)
    try:
        figure.savefig(path, dpi=DPI)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error
