"""Draws the two pictures of `filter.md`: a slip among the residuals, and an alternative behind a mirror line.

    python docs/filter_picture.py [FOLDER]

Worlds and faults are those of `benchmarks/systematic.py`.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from wiclosure import se3
from wiclosure.colours import robot_colour
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.plot_residuals import draw_agreement, draw_residuals

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import systematic
import systematic_faults
import systematic_worlds

WALL_M = 6.0
IMAGES = Path(__file__).parent / "images"


def slip(folder: Path) -> None:
    """Residuals of two robots of which one is carried 5 m and turned by 30 degrees on its way."""
    rng = np.random.default_rng(3)
    (fault,) = (one for one in systematic_faults.FAULTS if one.name == "slip 5 m, 30 deg")
    case = systematic.make(systematic_worlds.site(2, rng), fault, rng)
    chosen = WiClosureFilter()
    links = chosen.gather(case.odometry, case.log).by_pair
    alignment = chosen.align(case.odometry, links)["a", "b"]
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 3.1), layout="constrained")
    assert alignment.fit is not None
    assert alignment.best is not None
    draw_agreement(left, alignment.fit)
    draw_residuals(right, links["a", "b"], alignment.best.T_a_b)
    figure.savefig(folder / "filter_slip.png", dpi=110)


def mirror(folder: Path) -> None:
    """Robot b where it is, and behind the wall that shows its image, with the bearings that a hears."""
    rng = np.random.default_rng(5)
    world = replace(systematic_worlds.roaming(2, rng), every=12)
    log = systematic_worlds.listen(world, systematic_worlds.Hearing(mirror=WALL_M, mirror_only=0.5), rng)
    a, b = world.truth["a"], world.truth["b"]
    figure, axes = plt.subplots(figsize=(5.6, 6.0), layout="constrained")
    image = b.positions * [1, -1, 1] + [0, 2 * WALL_M, 0]
    for path, label, number, style in (
        (a.positions, "a", 0, "-"),
        (b.positions, "b", 1, "-"),
        (image, "b's image", 1, "--"),
    ):
        axes.plot(path[:, 0], path[:, 1], style, color=robot_colour(number), linewidth=2.5, label=label)
    for measured in log.measurements:
        pose = a.at(np.array([measured.stamp_ns]))[0]
        for path in measured.paths:
            _ray(axes, pose, path.azimuth, float(measured.range_m or 0.0))
    axes.axhline(WALL_M, color="black", linewidth=2, label="wall")
    axes.set_aspect("equal")
    axes.set_xlim(-5, 55)
    axes.set_ylim(-45, 55)
    axes.set(xlabel="x, m", ylabel="y, m")
    axes.plot([], [], ".-", color="0.6", linewidth=0.7, label="direction and range that a hears")
    figure.legend(fontsize=11, loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(folder / "filter_mirror.png", dpi=110)


def _ray(axes: plt.Axes, pose: FloatArray, azimuth: float, range_m: float) -> None:
    end = se3.transform(pose, range_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.0]))
    axes.plot([pose[0, 3], end[0]], [pose[1, 3], end[1]], color="0.75", linewidth=0.5, zorder=0)
    axes.plot(end[0], end[1], ".", color="0.5", markersize=3)


def main() -> None:
    """Writes both."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else IMAGES
    slip(folder)
    mirror(folder)


if __name__ == "__main__":
    main()
