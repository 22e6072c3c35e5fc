"""Pictures of how the measurements fit an alignment: counts and residuals over time, and circles of ranges."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentFit, FloatArray, FrameAlignment
from wiclosure.wiclosure_filter.links.links import Links

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_CIRCLES = 40
_COLORS = {"bearings": "#cc79a7", "ranges": "#56b4e9"}


def draw_agreement(axes: Axes, fit: AlignmentFit) -> None:
    """How many bearings and ranges agree, of how many, by time."""
    seconds = (fit.starts_ns - fit.starts_ns[0]) / 1e9
    width = (seconds[1] if len(seconds) > 1 else 1.0) * 0.4
    for name, offset, total, agreeing in (
        ("bearings", 0.0, fit.bearings, fit.agreeing_bearings),
        ("ranges", width, fit.ranges, fit.agreeing_ranges),
    ):
        axes.bar(seconds + offset, total, width, align="edge", fill=False, edgecolor=_COLORS[name], linewidth=0.7)
        label = f"{agreeing.sum()} of {total.sum()} {name} agree"
        axes.bar(seconds + offset, agreeing, width, align="edge", color=_COLORS[name], label=label)
    axes.set_title("measurements that agree, of all, by time", fontsize=9)
    axes.set_xlabel("s after the first", fontsize=9)
    axes.set_ylim(0.0, 1.25 * max(fit.bearings.max(), fit.ranges.max(), 1))  # room for the legend
    axes.legend(fontsize=8, ncols=2, frameon=False, loc="upper center")


def draw_residuals(axes: Axes, heard: Links, T_a_b: FloatArray) -> None:
    """Measured minus predicted ranges (m), or azimuths of the path nearest to the prediction (degrees), over time."""
    seconds = (heard.stamp_a_ns - heard.stamp_a_ns.min()) / 1e9
    seen = displacements(heard, T_a_b)
    title = []
    if heard.has_range.any():
        residual = heard.range_m - np.linalg.norm(seen, axis=1)
        axes.errorbar(seconds, residual, heard.range_sigma_m, fmt=".", color=_COLORS["ranges"], label="ranges")
        axes.set_ylabel("m", fontsize=9)
        title.append("ranges in m")
    if heard.has_bearing.any():
        degrees = axes.twinx() if title else axes
        degrees.plot(seconds, np.degrees(nearest_azimuths(heard, seen)), "x", color=_COLORS["bearings"])
        degrees.set_ylabel("degrees", fontsize=9)
        title.append("azimuths in degrees (crosses)")
    axes.axhline(0.0, color="black", linewidth=0.5)
    axes.set_title(f"measured minus predicted: {', '.join(title)}", fontsize=9)
    axes.set_xlabel("s after the first", fontsize=9)


def draw_circles(axes: Axes, heard: Links) -> None:
    """Circles around a's antenna on which b's must lie, evenly over the time, where no bearing tells where."""
    from matplotlib.collections import EllipseCollection

    rows = np.flatnonzero(heard.has_range)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(MOST_CIRCLES, len(rows))).round().astype(np.int64))]
    diameter = 2 * heard.range_m[rows]
    circles = EllipseCollection(
        diameter,
        diameter,
        np.zeros(len(rows)),
        units="xy",
        offsets=heard.antenna_a[rows, :2],
        offset_transform=axes.transData,
        facecolors="none",
        edgecolors=_COLORS["ranges"],
        linewidths=0.4,
    )
    axes.add_collection(circles)


def draw_fit(panels: tuple[Axes, Axes], heard: Links, alignment: FrameAlignment | None) -> None:
    """Both panels, or empty ones where nothing is aligned."""
    if alignment is None or alignment.fit is None or alignment.best is None or len(heard) == 0:
        for axes in panels:
            axes.set_axis_off()
        return
    draw_agreement(panels[0], alignment.fit)
    draw_residuals(panels[1], heard, alignment.best.T_a_b)


def displacements(heard: Links, T_a_b: FloatArray) -> FloatArray:
    """`(M, 3)` receiver to transmitter in the receiver's odometry axes, by an alignment."""
    a_in_b = se3.transform(se3.inverse(T_a_b), heard.antenna_a)
    seen_by_a = se3.transform(T_a_b, heard.antenna_b) - heard.antenna_a
    return np.where(heard.a_receives[:, None], seen_by_a, a_in_b - heard.antenna_b)


def nearest_azimuths(heard: Links, seen: FloatArray) -> FloatArray:
    """Residual `(M,)` of the path nearest to the predicted azimuth; NaN without paths."""
    in_axes = np.einsum("mji,mj->mi", heard.R_odom_axes, seen)
    off = se3.wrap_angle(heard.azimuth - np.arctan2(in_axes[:, 1], in_axes[:, 0])[:, None])
    off = np.where(heard.path >= 0, off, np.inf)
    nearest = off[np.arange(len(off)), np.argmin(np.abs(off), axis=1)]
    return np.where(np.isfinite(nearest), nearest, np.nan)
