"""The merged map from above, as a picture."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.colours import robot_colour
from wiclosure.pipeline.report.pictures import INK, new_figure, save
from wiclosure.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 400_000
_WIDTH_IN = 8.0
_MARGIN_M = 20.0
_EDGE_M = 1.0


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
    low, high = _window(merged, driven)
    width, height = high - low
    figure = new_figure(_WIDTH_IN, _WIDTH_IN * float(np.clip(height / width, 0.4, 1.3)) + 0.4)
    axes = figure.subplots()
    rows = _shown(merged, low, high)
    pale = 1.0 - 0.65 * (1.0 - merged.colours[rows] / 255)
    size = _point_size(figure, len(rows))
    axes.scatter(merged.points[rows, 0], merged.points[rows, 1], s=size, c=pale, linewidths=0, rasterized=True)
    for number, (robot, place) in enumerate(paths.items()):
        if len(place):
            axes.plot(*place[:, :2].T, color="white", linewidth=3.6, zorder=3)
            axes.plot(*place[:, :2].T, color=robot_colour(number), linewidth=2.0, label=robot, zorder=4)
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x, m", ylabel="y, m")
    figure.legend(loc="outside upper center", frameon=False, ncols=min(len(paths), 6), labelcolor=INK)
    save(figure, path)


def _window(merged: MergedMap, driven: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Corners of what is shown: where robots were with some metres around, as far as nearly all points there reach."""
    low, high = driven.min(axis=0), driven.max(axis=0)
    margin_m = max(_MARGIN_M, 0.15 * float((high - low).max()))
    places = merged.points[:, :2].astype(float)
    near = places[((places >= low - margin_m) & (places <= high + margin_m)).all(axis=1)]
    if not len(near):
        return low - margin_m, high + margin_m
    least, most = np.quantile(near, [0.001, 0.999], axis=0)
    return np.minimum(low, least) - _EDGE_M, np.maximum(high, most) + _EDGE_M


def _point_size(figure: Figure, points: int) -> float:
    """Area of a point, in square points of print: few points are drawn larger, so that walls are seen as such."""
    width, height = 72 * figure.get_size_inches()
    return float(np.clip(0.5 * width * height / max(points, 1), 0.25, 1.5))


def _shown(merged: MergedMap, low: FloatArray, high: FloatArray) -> np.ndarray:
    """Rows of the points to draw, the highest last; a random but fixed choice of very many."""
    inside = np.flatnonzero(((merged.points[:, :2] >= low) & (merged.points[:, :2] <= high)).all(axis=1))
    if len(inside) > POINTS:
        inside = np.random.default_rng(0).choice(inside, POINTS, replace=False)
    return inside[np.argsort(merged.points[inside, 2], kind="stable")]
