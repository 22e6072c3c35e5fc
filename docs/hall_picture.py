"""Draws the README's picture from what `wiclosure reproduce shell-space --seeds 2 --out results/hall` wrote.

python docs/hall_picture.py results/hall/seed-0/strong docs/images/hall.png
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
import open3d as o3d
from matplotlib.axes import Axes

from wiclosure import Trajectory, read_tum, se3
from wiclosure.colours import robot_colour
from wiclosure.display import significant

BLUE, ORANGE, RED, GREY, INK = robot_colour(0), robot_colour(1), "#c8102e", "#8c8c8c", "#1d2329"


def poses(folder: Path, name: str) -> Trajectory:
    """A trajectory of a run's folder."""
    return read_tum(folder / f"{name}.tum", name)


def draw(axes: Axes, folder: Path, hall: np.ndarray, T_map_world: np.ndarray) -> None:
    """One arm, with the first robot on its true path, and the second where the merged map has it."""
    alpha, beta = poses(folder, "alpha"), poses(folder, "beta")
    true_alpha, true_beta = (poses(folder, f"{name}_ground_truth").poses for name in ("alpha", "beta"))
    T_world_run = true_alpha[0] @ se3.inverse(alpha.poses[0])
    to_map = T_map_world @ T_world_run
    merged = (to_map @ beta.poses)[:, :2, 3]
    truth = (T_map_world @ true_beta)[:, :2, 3]
    axes.plot(*hall.T, "s", ms=1.6, color=GREY, rasterized=True, zorder=0)
    apart_m = float(np.linalg.norm(merged - truth, axis=1).max())
    if apart_m > 1.0:
        axes.plot(*truth.T, "--", color=INK, lw=2.0, label="where beta really drove")
        for i in (0, -1):
            axes.annotate("", merged[i], truth[i], arrowprops={"arrowstyle": "->", "color": RED, "lw": 1.6})
    axes.plot(*(to_map @ alpha.poses)[:, :2, 3].T, color=BLUE, lw=4, label="robot alpha")
    axes.plot(*merged.T, color=ORANGE, lw=4, label="robot beta, as merged")
    metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
    closures = metrics["closures"]
    title = "Without radio" if metrics["filter"] == "none" else "With four radio measurements"
    accepted, false = closures["accepted"], closures["accepted_false"]
    count = "all" if false == accepted else false or "none"
    axes.set_title(
        f"{title}: {significant(metrics['ate_m']['team'])} m off\n{accepted} closures accepted, {count} of them false",
        fontsize=18,
    )
    axes.set_aspect("equal")
    axes.axis("off")


def main(arms: Path, picture: Path) -> None:
    """Both arms side by side, over the hall as the arm with radio maps it."""
    good = arms / "wiclosure"
    cloud = np.asarray(o3d.io.read_point_cloud(good / "map.ply").points)
    tall = cloud[(cloud[:, 2] > 0.2) & (cloud[:, 2] < 1.2)][:, :2]
    T_map_world = poses(good, "alpha").poses[0] @ se3.inverse(poses(good, "alpha_ground_truth").poses[0])
    figure, (left, right) = plt.subplots(1, 2, figsize=(14, 7.6), layout="constrained")
    draw(left, arms / "none", tall, T_map_world)
    draw(right, good, tall, T_map_world)
    entries = dict(zip(*reversed(left.get_legend_handles_labels()), strict=True))
    entries |= dict(zip(*reversed(right.get_legend_handles_labels()), strict=True))
    figure.legend(entries.values(), entries, loc="outside lower center", ncols=4, fontsize=15, frameon=False)
    figure.savefig(picture, dpi=80, pil_kwargs={"optimize": True})


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
