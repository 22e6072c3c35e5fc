"""Scenario `kitti08`: streets built along a recorded trajectory, driven again in three parts at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from wiclosure.errors import InputError
from wiclosure.simulation.world.ground import Ground, rough_ground
from wiclosure.simulation.world.motion import START_NS, GroundPath, Motion, Sway, on_ground, smoothed
from wiclosure.simulation.world.scene import Scene, SceneBuilder
from wiclosure.simulation.world.streets import line_with_lots
from wiclosure.types import FloatArray, IntArray

FRAME_NS = 100_000_000
"""KITTI's LiDAR turns ten times per second."""

SENSOR_HEIGHT_M = 1.73

_SMOOTH_FRAMES = 3.0
_CROOKED = 0.01
_FASTEST_M = 7.0  # between two poses, a tenth of a second apart: 250 km/h
_SPEED_MPS = 9.0
_SWAY_DEG, _SHORTEST_WAVE_M = 0.08, 30.0  # a scan's roll and pitch differ from the trend by 0.12 degrees, as recorded
_ROBOTS = ("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta")


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """Motion through recorded positions, on simulated ground.

    Args:
        xy_m: `(K, 2)` positions, one a frame.
        yaw_rad: `(K,)` headings without jumps of 2 pi.
        ground: gives height and tilt.
        sway: of the body on its wheels.
    """

    xy_m: FloatArray
    yaw_rad: FloatArray
    ground: Ground
    sway: Sway

    @property
    def duration_ns(self) -> int:
        """See `Motion`."""
        return (len(self.xy_m) - 1) * FRAME_NS

    @cached_property
    def _travelled(self) -> PchipInterpolator:
        steps = np.linalg.norm(np.diff(self.xy_m, axis=0), axis=1)
        return PchipInterpolator(np.arange(len(self.xy_m)), np.concatenate([[0.0], np.cumsum(steps)]))

    @cached_property
    def _curve(self) -> CubicSpline:
        return CubicSpline(np.arange(len(self.xy_m)), np.column_stack([self.xy_m, self.yaw_rad]))

    def T_world_body(self, stamps_ns: IntArray) -> FloatArray:
        """See `Motion`."""
        frame = np.clip((stamps_ns - START_NS) / FRAME_NS, 0.0, len(self.xy_m) - 1.0)
        x_y_yaw = np.asarray(self._curve(frame), float)
        T_world_level = on_ground(self.ground, x_y_yaw[:, :2], x_y_yaw[:, 2], SENSOR_HEIGHT_M)
        T_world_level[:, :3, :3] @= self.sway.rotations(self._travelled(frame))
        return T_world_level


def read_positions(path: Path) -> tuple[FloatArray, FloatArray]:
    """Positions `(K, 2)` and headings `(K,)` of a KITTI poses file (12 numbers per line, camera axes).

    Raises:
        InputError: the file cannot be read or is not of that form.
    """
    try:
        lines = path.read_text(encoding="ascii").splitlines()
        rows = np.loadtxt(lines, dtype=float, ndmin=2) if any(map(str.strip, lines)) else np.zeros((0, 0))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot read KITTI poses ({error}); expected 12 numbers per line") from error
    if rows.shape[1] != 12 or len(rows) < 20:
        raise InputError(
            f"{path}: {rows.shape[0]} lines of {rows.shape[1]} numbers; expected 20 or more KITTI poses, 12 numbers"
            " per line"
        )
    if not (finite := np.isfinite(rows).all(axis=1)).all():
        raise InputError(f"{path}, line {np.argmin(finite) + 1}: not all 12 numbers are finite")
    T = rows.reshape(-1, 3, 4)
    crooked = np.abs(T[:, :, :3] @ np.swapaxes(T[:, :, :3], 1, 2) - np.eye(3)).max(axis=(1, 2)) > _CROOKED
    if crooked.any():
        raise InputError(
            f"{path}, line {np.argmax(crooked) + 1}: the first three columns are no rotation; expected KITTI poses,"
            " row by row [R t]"
        )
    # Camera axes: x right, y down, z forward. Ours: x forward, y left.
    xy = np.stack([T[:, 2, 3], -T[:, 0, 3]], axis=1)
    yaw = np.unwrap(np.arctan2(-T[:, 0, 2], T[:, 2, 2]))
    steps_m = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    if len(leaps := np.flatnonzero(steps_m > _FASTEST_M)):
        raise InputError(
            f"{path}, line {leaps[0] + 2}: {steps_m[leaps[0]]:.0f} m from the line before; expected metres, ten lines a"
            f" second, so at most {_FASTEST_M:g} m between two"
        )
    if steps_m.sum() < 50:
        raise InputError(f"{path}: the poses cover less than 50 m; streets need a longer drive")
    smooth = smoothed(np.column_stack([xy, yaw]), _SMOOTH_FRAMES)
    return smooth[:, :2], smooth[:, 2]


def scene(xy_m: FloatArray, rng: np.random.Generator, aliasing: float) -> Scene:
    """Houses along the whole trajectory `(K, 2)`."""
    low, high = xy_m.min(axis=0) - 90, xy_m.max(axis=0) + 90
    builder = SceneBuilder(
        rough_ground(
            rng, (low[0], low[1]), (high[0], high[1]), 1.5, cell_m=2.5, wavelengths_m=(_SHORTEST_WAVE_M, 250.0)
        )
    )
    line_with_lots(builder, [_centre_line(xy_m)], rng, aliasing)
    return builder.build()


def _centre_line(xy_m: FloatArray) -> GroundPath:
    """The driven line with even spacing."""
    step = np.linalg.norm(np.diff(xy_m, axis=0), axis=1)
    moved = np.append(True, step > 1e-3)
    at = np.concatenate([[0.0], np.cumsum(step)])[moved]
    even = np.linspace(0.0, at[-1], int(at[-1] / 0.5) + 2)
    return GroundPath.smoothed(np.stack([np.interp(even, at, values) for values in xy_m[moved].T], axis=1), 2.0)


def robots(xy_m: FloatArray, yaw_rad: FloatArray, world: Scene, count: int) -> dict[str, Motion]:
    """The trajectory in `count` contiguous parts, all started together."""
    parts = zip(np.array_split(xy_m, count), np.array_split(yaw_rad, count), strict=True)
    return {
        name: RecordedMotion(xy, yaw, world.ground, Sway.of(_SWAY_DEG, _SPEED_MPS, number))
        for number, (name, (xy, yaw)) in enumerate(zip(_ROBOTS[:count], parts, strict=True))
    }
