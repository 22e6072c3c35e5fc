"""Draws the picture of `scaling.md` from what `benchmarks/fleet.py --rows filter --csv docs/scaling.csv` measured.

python docs/scaling_picture.py [FOLDER]
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from wiclosure.colours import robot_colour

HERE = Path(__file__).parent


def curve(axes: Axes, robots: list[float], values: list[float], title: str, form: str, *, log: bool = False) -> None:
    """Values against the number of robots, each with its figure; `log`: with a logarithmic axis."""
    axes.plot(robots, values, "o-", color=robot_colour(0), linewidth=2.5)
    for count, value in zip(robots, values, strict=True):
        axes.annotate(form.format(value), (count, value), (-2, 7), textcoords="offset points", ha="right", fontsize=11)
    axes.set_xscale("log")
    axes.set_xticks(robots, [f"{count:g}" for count in robots])
    if log:
        axes.set_yscale("log")
    axes.minorticks_off()
    axes.margins(x=0.12)
    axes.set_ylim(0.5 * min(values) if log else 0, (2 if log else 1.25) * max(values))
    axes.set_title(title, fontsize=12)
    axes.set_xlabel("robots")
    axes.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Writes it."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "images"
    with (HERE / "scaling.csv").open(encoding="utf-8") as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    one_process_first = sorted(rows, key=lambda row: (row["robots"], row["jobs"]))
    rows = list({row["robots"]: row for row in reversed(one_process_first)}.values())[::-1]
    robots = [row["robots"] for row in rows]
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(10.5, 3.2), layout="constrained", facecolor="white")
    a_pair_ms = [1e3 * row["processor_s"] / row["meeting"] for row in rows]
    curve(left, robots, a_pair_ms, "ms of one core per meeting pair", "{:.0f}")
    curve(middle, robots, [row["processor_s"] for row in rows], "seconds of one core", "{:.0f}", log=True)
    curve(right, robots, [row["peak_mb"] / 1e3 for row in rows], "peak memory, GB", "{:.1f}", log=True)
    figure.savefig(folder / "scaling.png", dpi=110)


if __name__ == "__main__":
    main()
