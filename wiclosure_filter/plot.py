"""Pictures of what the filter did with two robots (the paper's figures 2, 3 and 5).

matplotlib is imported when a picture is drawn, not before.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from wiclosure import se3
from wiclosure.colours import robot_colour
from wiclosure.errors import OutputError
from wiclosure.types import (
    AlignmentHypothesis,
    CandidatePairs,
    FilterResult,
    FloatArray,
    FrameAlignment,
    IntArray,
    Trajectory,
    WirelessLog,
)
from wiclosure.wiclosure_filter.config import FilterSettings, GateSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links
from wiclosure.wiclosure_filter.plot_residuals import draw_circles, draw_fit
from wiclosure.wiclosure_filter.search.ball_probability import principal_axes
from wiclosure.wiclosure_filter.search.gates import Gate, make_gate
from wiclosure.wiclosure_filter.search.overlap_search import SearchTrace, find_overlap
from wiclosure.wiclosure_filter.search.pair_model import PairModel
from wiclosure.wiclosure_filter.search.segments import SegmentTree
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedEstimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

KEPT, REJECTED = "#222222", "#bbbbbb"
RobotColours: TypeAlias = tuple[str, str]
"""Of robots a and b: those that each has everywhere."""
SEARCH_PANELS = 4
MOST_LINES = 1500
ELLIPSES = 25
CHI_90 = 2.146  # standard deviations that hold 90 % of a Gaussian in the plane


def save_pictures(
    result: FilterResult,
    trajectories: Mapping[str, Trajectory],
    wireless: WirelessLog,
    settings: FilterSettings,
    folder: Path | str,
) -> tuple[Path, ...]:
    """One PNG for each pair of robots that the radio joins or that heard each other.

    Args:
        result: of the filter, with these trajectories, measurements and settings.
        trajectories: keyframes.
        wireless: measurements.
        settings: of the filter.
        folder: for `filter_<a>_<b>.png`; made if missing.

    Raises:
        OutputError: the folder cannot be written.
    """
    folder = Path(folder)
    alignments = {(a.robot_a, a.robot_b): a for a in result.alignments}
    links = TeamLinks.of(trajectories, wireless, GatheringLimits.of(settings.alignment)).by_pair
    written = []
    for pairs in result.pairs:
        alignment = alignments.get((pairs.robot_a, pairs.robot_b))
        if pairs.predicts is None and alignment is None:
            continue
        figure = draw_pair(pairs, alignment, trajectories, links[pairs.robot_a, pairs.robot_b], settings.gate)
        path = folder / f"filter_{_file_name(pairs.robot_a)}_{_file_name(pairs.robot_b)}.png"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            figure.savefig(path, dpi=160)
        except OSError as error:
            raise OutputError(f"{path}: cannot write the picture ({error.strerror})") from error
        written.append(path)
    return tuple(written)


def draw_pair(
    pairs: CandidatePairs,
    alignment: FrameAlignment | None,
    trajectories: Mapping[str, Trajectory],
    links: Links,
    gate: GateSettings,
) -> Figure:
    """Links, shared trajectory, kept pairs, the steps of the search, and how the measurements fit, for two robots."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 9.2), layout="constrained")
    grid = figure.add_gridspec(3, 12)
    top = [figure.add_subplot(grid[0, 4 * i : 4 * i + 4]) for i in range(3)]
    bottom = [figure.add_subplot(grid[1, 3 * i : 3 * i + 3]) for i in range(SEARCH_PANELS)]
    names = list(trajectories)
    colours = (robot_colour(names.index(pairs.robot_a)), robot_colour(names.index(pairs.robot_b)))
    _draw_links(top[0], links, alignment, trajectories, colours)
    draw_fit((figure.add_subplot(grid[2, :6]), figure.add_subplot(grid[2, 6:])), links, alignment)
    model = _model(pairs)
    if model is None:
        for axes in (*top[1:], *bottom):
            axes.text(0.5, 0.5, "nothing joins the robots", ha="center", transform=axes.transAxes)
            axes.set_axis_off()
    else:
        _draw_shared(top[1], model, pairs, colours)
        _draw_kept(top[2], model, pairs, gate.sensor_range_m, colours)
        _draw_search(bottom, model, make_gate(gate), colours)
    figure.suptitle(f"{pairs.robot_a} and {pairs.robot_b}: {len(pairs):,} pairs kept")
    return figure


def _model(pairs: CandidatePairs) -> PairModel | None:
    """The prediction behind the pairs; of shortest routes the one over the first link, of alternatives the best."""
    estimate = _estimate(pairs)
    return None if estimate is None else estimate.models(pairs.robot_a, pairs.robot_b)[0]


def _estimate(pairs: CandidatePairs) -> SharedEstimate | None:
    """The predictor, where it predicts displacements of all pairs: other filters' predictors cannot be drawn."""
    return pairs.predictor if isinstance(pairs.predictor, SharedEstimate) else None


def _draw_links(
    axes: Axes,
    heard: Links,
    alignment: FrameAlignment | None,
    trajectories: Mapping[str, Trajectory],
    colours: RobotColours,
) -> None:
    """Both odometries in the frame of a, and every path heard: kept ones, and those taken for reflections."""
    best = None if alignment is None else alignment.best
    T_a_b = np.eye(4) if best is None else best.T_a_b
    positions_a = trajectories[heard.robot_a].positions
    positions_b = se3.transform(T_a_b, trajectories[heard.robot_b].positions)
    kept, rejected = _path_lines(heard, best, T_a_b)
    _lines(axes, rejected, REJECTED, "rejected paths")
    _lines(axes, kept, KEPT, "kept paths")
    if best is not None and not heard.has_bearing.any():
        draw_circles(axes, heard)
    _road(axes, positions_a, colours[0], heard.robot_a)
    _road(axes, positions_b, colours[1], heard.robot_b)
    reason = "no alignment" if alignment is None else alignment.reason
    remark = "; ambiguous" if alignment is not None and alignment.ambiguous else ""
    axes.set_title(f"links and alignment{remark}\n{reason}", fontsize=9)
    axes.legend(fontsize=8)


def _path_lines(heard: Links, best: AlignmentHypothesis | None, T_a_b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lines `(L, 2, 2)` from the receiver along its paths, kept and rejected; 20 m where nothing was ranged."""
    path_of = {} if best is None else dict(best.paths_kept)
    taken = np.array([path_of.get(int(m), -1) for m in heard.measurement], np.int64)[:, None] == heard.path
    length = np.where(np.isfinite(heard.range_m), heard.range_m, 20.0)[:, None, None]
    at_b = np.swapaxes(np.broadcast_to(T_a_b[:3, :3], (len(heard), 3, 3)), 1, 2)
    turned = np.where(heard.a_receives[:, None, None], heard.direction, heard.direction @ at_b)
    start = np.where(heard.a_receives[:, None], heard.antenna_a, se3.transform(T_a_b, heard.antenna_b))
    start = np.broadcast_to(start[:, None], turned.shape)
    lines = np.stack([start, start + length * turned], axis=2)[..., :2]
    there = heard.path >= 0
    return lines[there & taken], lines[there & ~taken]


def _draw_shared(axes: Axes, model: PairModel, pairs: CandidatePairs, colours: RobotColours) -> None:
    """Both trajectories in one frame; ellipses hold the place of b, seen from the nearest pose of a, with 90 %."""
    from matplotlib.collections import EllipseCollection

    a, b = model.a.positions, model.b.positions
    rows = np.unique(np.linspace(0, len(b) - 1, ELLIPSES).round().astype(np.int64))
    nearest = np.array([int(np.argmin(np.sum((a - b[row]) ** 2, axis=1))) for row in rows], np.int64)
    variance, directions = principal_axes(model.covariance(nearest, rows)[:, :2, :2])
    width = 2 * CHI_90 * np.sqrt(variance)
    angle = np.degrees(np.arctan2(directions[:, 1, 1], directions[:, 0, 1]))
    axes.add_collection(
        EllipseCollection(
            width[:, 1],
            width[:, 0],
            angle,
            units="xy",
            offsets=b[rows, :2],
            offset_transform=axes.transData,
            facecolors="none",
            edgecolors=colours[1],
            linewidths=0.8,
        )
    )
    _road(axes, a, colours[0], pairs.robot_a)
    _road(axes, b, colours[1], pairs.robot_b)
    estimate = _estimate(pairs)
    likely = 1 if estimate is None else estimate.alternatives
    which = "shared trajectory" if likely == 1 else f"shared trajectory, the likeliest of {likely}"
    axes.set_title(f"{which}\n90 % of {pairs.robot_b}, seen from {pairs.robot_a}", fontsize=9)


def _draw_kept(
    axes: Axes, model: PairModel, pairs: CandidatePairs, sensor_range_m: float, colours: RobotColours
) -> None:
    """Lines between the keyframes of kept pairs, the more probable the darker."""
    from matplotlib.collections import LineCollection

    rows = np.unique(np.linspace(0, len(pairs) - 1, min(MOST_LINES, len(pairs))).round().astype(np.int64))
    ends = np.stack([model.a.positions[pairs.index_a[rows]], model.b.positions[pairs.index_b[rows]]], axis=1)
    lines = LineCollection(list(ends[:, :, :2]), cmap="viridis_r", linewidths=0.5)
    lines.set_array(pairs.overlap_probability[rows])
    lines.set_clim(0.0, 1.0)
    axes.add_collection(lines)
    axes.figure.colorbar(lines, ax=axes, label=f"probability to be within {sensor_range_m:g} m")
    _road(axes, model.a.positions, colours[0], pairs.robot_a)
    _road(axes, model.b.positions, colours[1], pairs.robot_b)
    total = len(model.a) * len(model.b)
    axes.set_title(f"kept pairs\n{len(pairs):,} of {total:,}, {len(rows):,} drawn", fontsize=9)


def _draw_search(panels: list[Axes], model: PairModel, gate: Gate, colours: RobotColours) -> None:
    """Boxes that survive, at steps spread from the roots to the leaves."""
    trace = SearchTrace()
    find_overlap(model, gate, trace)
    trees = [SegmentTree.of(part.positions, part.own_variance) for part in (model.a, model.b)]
    steps = sorted(trace.steps, reverse=True)
    chosen = np.unique(np.linspace(0, len(steps) - 1, len(panels)).round().astype(int))
    for axes in panels[len(chosen) :]:
        axes.set_axis_off()
    for axes, number in zip(panels, chosen, strict=False):
        parts = trace.steps[steps[number]]
        survivors = sum(len(segment_a) for _, _, segment_a, _ in parts)
        height_a, height_b, _, _ = parts[0]
        _boxes(axes, trees[0], height_a, np.unique(np.concatenate([part[2] for part in parts])), colours[0])
        _boxes(axes, trees[1], height_b, np.unique(np.concatenate([part[3] for part in parts])), colours[1])
        _road(axes, model.a.positions, colours[0], None)
        _road(axes, model.b.positions, colours[1], None)
        boxes = "1 pair of boxes" if survivors == 1 else f"{survivors:,} pairs of boxes"
        axes.set_title(f"overlap search, step {number + 1} of {len(steps)}\n{boxes}", fontsize=9)


def _boxes(axes: Axes, tree: SegmentTree, height: int, segments: IntArray, color: str) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    low, high = tree.heights[height].low[segments], tree.heights[height].high[segments]
    patches = [Rectangle((x, y), w, h) for (x, y), (w, h) in zip(low[:, :2], (high - low)[:, :2], strict=True)]
    axes.add_collection(PatchCollection(patches, facecolors=color, edgecolors=color, alpha=0.3))


def _road(axes: Axes, positions: FloatArray, color: str, label: str | None) -> None:
    axes.plot(positions[:, 0], positions[:, 1], color=color, linewidth=1.2, label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.tick_params(labelsize=8)
    axes.set_xlabel("x in m", fontsize=9)
    axes.set_ylabel("y in m", fontsize=9)


def _lines(axes: Axes, lines: FloatArray, color: str, label: str) -> None:
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(lines), colors=color, linewidths=0.7, label=f"{len(lines)} {label}"))


def _file_name(robot: str) -> str:
    """The name, without what file systems do not like."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in robot)
