"""A simulated world from above: what stands in it, and where its robots drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wiclosure.colours import robot_colour
from wiclosure.pipeline.report.pictures import new_figure, save
from wiclosure.simulation.scenario import Scenario
from wiclosure.simulation.world.mesh import Mesh
from wiclosure.simulation.world.scene import Scene
from wiclosure.types import FloatArray

_EYE_LEVEL_M = 1.5
_MARGIN = 0.4
"""What is drawn beyond the robots' paths, as a share of what they span."""

_WIDTH_IN = 6.0


def draw_plan(scenario: Scenario, path: Path) -> None:
    """Writes the plan view.

    Raises:
        OutputError: it cannot be written.
    """
    from matplotlib.collections import PolyCollection

    paths = [scenario.ground_truth(robot).positions[:, :2] for robot in scenario.robots]
    solid, slight = (_outlines(mesh, scenario.scene) for mesh in (scenario.scene.solid, scenario.scene.slight))
    low, high = _limits(np.concatenate(paths), solid)
    figure = new_figure(_WIDTH_IN, _WIDTH_IN * float(np.clip((high - low)[1] / (high - low)[0], 0.3, 1.5)))
    axes = figure.subplots()
    for outlines, colour in ((slight, "#8cbf8c"), (solid, "#777777")):
        axes.add_collection(PolyCollection(list(outlines), facecolor=colour, edgecolor=colour, lw=0.6))
    for number, (robot, xy_m) in enumerate(zip(scenario.robots, paths, strict=True)):
        axes.plot(*xy_m.T, color=robot_colour(number), lw=1.8, label=robot)
        axes.plot(*xy_m[0], "o", color=robot_colour(number), ms=5)
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x, m", ylabel="y, m")
    figure.legend(loc="outside upper center", frameon=False, ncols=len(paths), fontsize=8)
    save(figure, path)


def _limits(driven: FloatArray, outlines: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corner `(2,)` of all that stands near the paths `(N, 2)`."""
    low, high = driven.min(axis=0), driven.max(axis=0)
    near_m = _MARGIN * (high - low).max()
    corners = np.concatenate([outlines.reshape(-1, 2), driven])  # on an empty plain there are only the paths
    return (
        np.clip(corners.min(axis=0) - 1.0, low - near_m, low),
        np.clip(corners.max(axis=0) + 1.0, high, high + near_m),
    )


def _outlines(mesh: Mesh, scene: Scene) -> FloatArray:
    """`(T, 3, 2)` triangles that begin below eye level, from above: no roofs, no ceilings."""
    height_m = mesh.vertices[:, 2] - scene.ground.height(mesh.vertices[:, :2].astype(float))
    corners = mesh.vertices[mesh.triangles]
    return np.asarray(corners[height_m[mesh.triangles].min(axis=1) < _EYE_LEVEL_M][..., :2], float)
