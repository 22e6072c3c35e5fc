"""The merged map from above, as a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wiclosure.backends.merged_map import MergedMap
from wiclosure.colours import robot_colour
from wiclosure.pipeline.report.pictures import INK, new_figure, save
from wiclosure.types import FloatArray

POINTS = 400_000
_WIDTH_IN = 8.0
_MARGIN_M = 20.0


def draw_map(path: Path, merged: MergedMap, paths: Mapping[str, FloatArray]) -> None:
    """The map's points, what stands above what lies flat, and the paths of the robots in it.

    Points are paler than the paths and take the colour of the robot that saw them.  Shown is where the robots were,
    with some metres around: single points far off would shrink the rest.

    Args:
        path: PNG to write.
        merged: the map.
        paths: `(N, 3)` m by robot, in the map's frame, empty for robots not in it; their order gives the colour.

    Raises:
        OutputError: the picture cannot be written.
    """
    driven = np.concatenate([place[:, :2] for place in paths.values() if len(place)])
    span_m = np.ptp(driven, axis=0).max()
    low, high = (driven.min(axis=0) - _margin(span_m), driven.max(axis=0) + _margin(span_m))
    width, height = high - low
    figure = new_figure(_WIDTH_IN, _WIDTH_IN * float(np.clip(height / width, 0.4, 1.3)) + 0.4)
    axes = figure.subplots()
    rows = _shown(merged, low, high)
    pale = 1.0 - 0.65 * (1.0 - merged.colours[rows] / 255)
    axes.scatter(merged.points[rows, 0], merged.points[rows, 1], s=0.25, c=pale, linewidths=0, rasterized=True)
    for number, (robot, place) in enumerate(paths.items()):
        if len(place):
            axes.plot(*place[:, :2].T, color="white", linewidth=3.6, zorder=3)
            axes.plot(*place[:, :2].T, color=robot_colour(number), linewidth=2.0, label=robot, zorder=4)
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x, m", ylabel="y, m")
    figure.legend(loc="outside upper center", frameon=False, ncols=min(len(paths), 6), labelcolor=INK)
    save(figure, path)


def _margin(span_m: float) -> float:
    return max(_MARGIN_M, 0.15 * span_m)


def _shown(merged: MergedMap, low: FloatArray, high: FloatArray) -> np.ndarray:
    """Rows of the points to draw, the highest last; a random but fixed choice of very many."""
    inside = np.flatnonzero(((merged.points[:, :2] >= low) & (merged.points[:, :2] <= high)).all(axis=1))
    if len(inside) > POINTS:
        inside = np.random.default_rng(0).choice(inside, POINTS, replace=False)
    return inside[np.argsort(merged.points[inside, 2], kind="stable")]
