"""What the 3-D view shows besides closures and links: robots' paths, keyframes and the map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.colours import ROBOT_COLOURS, robot_colour
from wiclosure.pipeline.report.html.packing import along_curve, packed_bytes, packed_steps, unpacked_array
from wiclosure.types import Float32Array, FloatArray, IntArray, Trajectory

MAP_POINTS = 300_000
MAP_STEP_M = 0.02
PATH_STEP_M = 0.005
PATH_POSES = 5_000
PATHS_POSES = 15_000
BESIDE_M = 10.0
BRIGHTNESS_STEPS = 32


@dataclass(frozen=True, eq=False)
class Placement:
    """Where the page draws robots: connected ones as they lie, what is not connected beside them.

    Args:
        offset: `(3,)` m by robot, to add to positions in the world of its component.
        connected: robots of the first component.
    """

    offset: Mapping[str, FloatArray]
    connected: frozenset[str]

    @classmethod
    def of(cls, components: Sequence[Sequence[str]], trajectories: Mapping[str, Trajectory]) -> Placement:
        """Components side by side along x, each in a frame of its own; the first lies around the origin.

        Numbers near zero hold centimetres in single precision, however large the coordinates are.
        """
        offset: dict[str, FloatArray] = {}
        edge_m = 0.0
        for number, group in enumerate(components):
            positions = np.concatenate([trajectories[robot].positions for robot in group])
            low, high = positions.min(axis=0), positions.max(axis=0)
            middle = (low + high) / 2
            if number:
                edge_m += BESIDE_M
                middle[0] = low[0] - edge_m
                edge_m += high[0] - low[0]
            else:
                edge_m = high[0] - middle[0]
            offset |= dict.fromkeys(group, -middle)
        return cls(offset, frozenset(components[0]))

    def together(self, first: str, second: str) -> bool:
        """Whether both lie in one frame."""
        return bool(np.array_equal(self.offset[first], self.offset[second]))


def robot_entry(
    number: int,
    robots: int,
    *,
    path: Trajectory,
    odometry: Trajectory,
    keyframes: Trajectory,
    placement: Placement,
    truth: FloatArray | None = None,
) -> dict[str, Any]:
    """A robot for the page.

    Args:
        number: of the robot, its colour.
        robots: how many there are; the more, the coarser each path.
        path: of all scans in the world of its component.
        odometry: the same before merging.
        keyframes: in the same world as `path`.
        placement: where to draw.
        truth: `(N, 3)` m, ground truth laid over the path; None: there is none.
    """
    robot, most = path.robot, max(500, min(PATH_POSES, PATHS_POSES // robots))
    offset = placement.offset[robot]

    def packed(positions: FloatArray) -> dict[str, Any]:
        return packed_steps(_thinned(positions, most), PATH_STEP_M)

    return {
        "name": robot,
        "colour": robot_colour(number),
        "connected": robot in placement.connected,
        "merged": packed(path.positions + offset),
        "odometry": packed(odometry.positions - odometry.positions[0]),
        "keyframes": packed_steps(keyframes.positions + offset, PATH_STEP_M),
        "keyframe_times": packed_steps((keyframes.stamps_ns - odometry.stamps_ns[0]) * 1e-9, 1e-3),
        "truth": None if truth is None else packed(truth + offset),
    }


def _thinned(positions: FloatArray, most: int) -> FloatArray:
    """At most so many of a path's positions, evenly, both ends among them."""
    if len(positions) <= most:
        return positions
    return positions[np.linspace(0, len(positions) - 1, most).round().astype(np.int64)]


def map_entry(merged: MergedMap, robots: int, offset: FloatArray) -> dict[str, Any] | None:
    """At most 300,000 points, a random but fixed choice, with the robot that each is mostly of."""
    if len(merged) == 0:
        return None
    rng = np.random.default_rng(0)
    rows = np.arange(len(merged)) if len(merged) <= MAP_POINTS else rng.choice(len(merged), MAP_POINTS, replace=False)
    points = merged.points[rows] + offset
    order = along_curve(points, MAP_STEP_M)
    palette = ROBOT_COLOURS[: min(robots, len(ROBOT_COLOURS))].astype(int)
    apart = [((merged.colours[rows].astype(int) - colour) ** 2).sum(axis=1) for colour in palette]
    robot = np.argmin(apart, axis=0)
    brightness = None if merged.intensity is None else _brightness(merged.intensity[rows], robot)
    return {
        "xyz": packed_steps(points[order], MAP_STEP_M),
        "robot": packed_bytes(robot[order]),
        "intensity": None if brightness is None else packed_bytes(brightness[order]),
        "heights_m": np.quantile(points[:, 2], [0.02, 0.98]).tolist(),
        "shown": len(rows),
        "of": len(merged),
    }


def _brightness(intensity: Float32Array, robot: IntArray) -> IntArray | None:
    """Rank `(N,)` of each point among its robot's, in steps 1 to 32; 0: not known; None: all are alike.

    Sensors report reflectivity, power or counts, in 0 to 1, 255 or 65,535: ranks need no unit.
    """
    rank = np.zeros(len(intensity), np.int64)
    for number in np.unique(robot):
        own = np.flatnonzero((robot == number) & np.isfinite(intensity))
        values = np.sort(intensity[own])
        below = (np.searchsorted(values, intensity[own]) + np.searchsorted(values, intensity[own], "right")) / 2
        rank[own] = 1 + (below * BRIGHTNESS_STEPS) // (len(own) or 1)
    return rank if len(np.unique(rank[rank > 0])) > 1 else None


def fewer_points(entry: dict[str, Any] | None, most: int) -> dict[str, Any] | None:
    """The same map with at most so many points; neighbours in the list are neighbours in space."""
    if entry is None or entry["shown"] <= most:
        return entry
    rows = np.linspace(0, entry["shown"] - 1, most).round().astype(np.int64)
    brightness = entry.get("intensity")
    return entry | {
        "xyz": packed_steps(unpacked_array(entry["xyz"])[rows], MAP_STEP_M),
        "robot": packed_bytes(unpacked_array(entry["robot"])[rows]),
        "intensity": brightness and packed_bytes(unpacked_array(brightness)[rows]),
        "shown": most,
    }
