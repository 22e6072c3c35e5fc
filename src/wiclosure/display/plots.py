"""Pictures of results for notebooks and scripts; drawn without global state, so that no window opens unasked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from wiclosure.arrays import FloatArray
from wiclosure.candidates import CandidatePairs
from wiclosure.colours import robot_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_KEPT = "#0072b2"


def plot_paths(
    paths: Mapping[str, FloatArray],
    closures: FloatArray,
    *,
    apart: Sequence[str] = (),
    background: FloatArray | None = None,
) -> Figure:
    """Robots' paths from above.

    Args:
        paths: `(N, 3)` m by robot; their order gives the colours.
        closures: `(K, 2, 3)` m, both ends of each closure between robots that are drawn together.
        apart: robots that lie in no common frame with the first: each gets a panel of its own.
        background: `(M, 3)` m, points of the map.
    """
    figure = _figure(6.4 + 3.2 * len(apart), 5.2)
    panels = figure.subplots(1, 1 + len(apart), squeeze=False, width_ratios=[2] + [1] * len(apart))[0]
    if background is not None:
        panels[0].scatter(*background[:, :2].T, s=0.3, color="#c4ccd2", linewidths=0, rasterized=True)
    for ends in closures:
        panels[0].plot(*ends[:, :2].T, color="#222222", linewidth=0.8, zorder=3)
    for number, (robot, place) in enumerate(paths.items()):
        panel = panels[1 + list(apart).index(robot)] if robot in apart else panels[0]
        panel.plot(*place[:, :2].T, color=robot_colour(number), linewidth=1.8, label=robot, zorder=2)
        panel.plot(*place[0, :2], "o", color=robot_colour(number), zorder=4)
    panels[0].set_title(f"{len(closures)} closure{'s' if len(closures) != 1 else ''}")
    for robot, panel in zip(apart, panels[1:], strict=True):
        panel.set_title(f"not connected: {robot}", parse_math=False)
    for panel in panels:
        _finish(panel)
    return figure


def plot_kept_pairs(kept: Sequence[CandidatePairs]) -> Figure:
    """Kept pairs of each two robots: keyframes of the one against those of the other, darker where more probable."""
    figure = _figure(4.6 * max(1, len(kept)), 4.4)
    panels = figure.subplots(1, max(1, len(kept)), squeeze=False)[0]
    for panel, pairs in zip(panels, kept, strict=False):
        known = np.isfinite(pairs.overlap_probability)
        shade = np.where(known, 0.25 + 0.75 * np.nan_to_num(pairs.overlap_probability), 1.0)
        panel.scatter(pairs.index_b, pairs.index_a, s=4, marker="s", color=_KEPT, alpha=shade, linewidths=0)
        panel.set(xlabel=f"keyframe of {pairs.robot_b}", ylabel=f"keyframe of {pairs.robot_a}")
        panel.set_title(f"{len(pairs):,} pairs kept")
        for text in (panel.xaxis.label, panel.yaxis.label):
            text.set_parse_math(False)  # names from recordings are no formulas
    return figure


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _finish(panel: Axes) -> None:
    panel.set(aspect="equal", xlabel="x, m", ylabel="y, m")
    panel.set_adjustable("datalim")
    legend = panel.legend(frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)
