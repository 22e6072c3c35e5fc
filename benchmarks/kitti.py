"""KITTI odometry sequences with real KISS-ICP trajectories, as several robots that start together."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory

DATA = Path(os.environ.get("WICLOSURE_DATA", Path(__file__).resolve().parent.parent.parent / "shared" / "data"))
ROBOTS = ("alpha", "beta", "gamma")
FRAME_NS = 100_000_000  # 10 Hz; the recordings' own times differ by microseconds


@dataclass(frozen=True)
class Team:
    """Robots with ground truth in one frame and odometry each in its own; equal stamps in both."""

    truth: dict[str, Trajectory]
    odometry: dict[str, Trajectory]

    def keyframes(self, spacing_m: float) -> Team:
        """Every so many metres of odometry."""
        chosen = {name: every(t, spacing_m) for name, t in self.odometry.items()}
        return Team(
            {name: self.truth[name].subset(rows) for name, rows in chosen.items()},
            {name: self.odometry[name].subset(rows) for name, rows in chosen.items()},
        )

    def without_impossible(self) -> Team:
        """Without the keyframes where the ground truth cannot be one."""
        rows = {name: np.flatnonzero(~impossible(t)) for name, t in self.truth.items()}
        return Team(
            {name: t.subset(rows[name]) for name, t in self.truth.items()},
            {name: t.subset(rows[name]) for name, t in self.odometry.items()},
        )

    def worse(self, factor: float, seed: int) -> Team:
        """Odometry with planar errors added, so that it drifts `factor` >= 1 times as much as its drift model says."""
        rng = np.random.default_rng(seed)
        return Team(self.truth, {robot: _worse(t, np.sqrt(factor**2 - 1), rng) for robot, t in self.odometry.items()})


def impossible(truth: Trajectory, over_m: float = 20.0, most_deg: float = 3.0) -> BoolArray:
    """Poses `(N,)` of a car's ground truth whose motion over some metres leaves its own length by what no wheels allow.

    The truth of 08 climbs 14 m in its first 40 m, at up to 35 degrees, while the car it states stays level.
    """
    ends = np.minimum(np.searchsorted(truth.distance, truth.distance + over_m), len(truth) - 1)
    steps = np.diff(truth.positions, axis=0)
    own = np.einsum("nji,nj->ni", truth.poses[:-1, :3, :3], steps)
    along = np.concatenate([np.zeros((1, 3)), np.cumsum(own, axis=0)])
    moved = along[ends] - along[np.arange(len(truth))]
    steep = np.abs(moved[:, 2]) > np.tan(np.radians(most_deg)) * np.abs(moved[:, 0])
    within = np.searchsorted(truth.distance, truth.distance - over_m)
    counts = np.concatenate([[0], np.cumsum(steep)])
    return counts[np.arange(len(truth)) + 1] > counts[within]


def _worse(odometry: Trajectory, factor: float, rng: np.random.Generator) -> Trajectory:
    drift = odometry.drift
    steps = se3.between(odometry.poses[:-1], odometry.poses[1:])
    metres, turn = np.linalg.norm(steps[:, :3, 3], axis=1), se3.rotation_angle(steps)
    sigma = np.zeros((len(steps), 6))
    sigma[:, 2] = np.sqrt(drift.rotation_walk**2 * metres + drift.rotation_walk_turning**2 * turn)
    sigma[:, 3:5] = (drift.translation_walk * np.sqrt(metres))[:, None]
    poses = [odometry.poses[0]]
    for step in steps @ se3.exp(factor * sigma * rng.normal(size=sigma.shape)):
        poses.append(poses[-1] @ step)
    return Trajectory(odometry.robot, odometry.stamps_ns, np.array(poses), drift)


def every(trajectory: Trajectory, spacing_m: float) -> IntArray:
    """Poses at least so many metres from the one chosen before."""
    chosen = [0]
    for row, position in enumerate(trajectory.positions):
        if np.linalg.norm(position - trajectory.positions[chosen[-1]]) >= spacing_m:
            chosen.append(row)
    return np.array(chosen, np.int64)


def lidar_poses(kind: str, sequence: str) -> FloatArray:
    """`(N, 4, 4)` of `gt` or `kiss_icp`, turned from camera to LiDAR axes (x forward, y left, z up)."""
    folder = DATA / "kitti_odometry"
    T_camera_lidar = np.eye(4)
    for line in (folder / "00_calib.txt").read_text().splitlines():
        if line.startswith("Tr:"):
            T_camera_lidar[:3] = np.array(line.split()[1:], float).reshape(3, 4)
    rows = np.loadtxt(folder / kind / f"{sequence}.txt").reshape(-1, 3, 4)
    # Six digits in the file: make rotations orthonormal again.
    U, _, Vt = np.linalg.svd(rows[:, :, :3])
    T_start_camera = se3.from_rotation_translation(U @ Vt, rows[:, :, 3])
    return np.asarray(se3.inverse(T_camera_lidar) @ T_start_camera @ T_camera_lidar)


def thirds(sequence: str, drift: DriftModel | None = None) -> Team:
    """Three contiguous thirds as three robots that start at the same time."""
    truth, odometry = lidar_poses("gt", sequence), lidar_poses("kiss_icp", sequence)
    size = len(truth) // 3
    stamps_ns = np.arange(size, dtype=np.int64) * FRAME_NS
    drift = drift or DriftModel()
    parts = {robot: slice(i * size, (i + 1) * size) for i, robot in enumerate(ROBOTS)}
    return Team(
        {robot: Trajectory(robot, stamps_ns, truth[part]) for robot, part in parts.items()},
        {
            robot: Trajectory(robot, stamps_ns, se3.between(odometry[part.start], odometry[part]), drift)
            for robot, part in parts.items()
        },
    )
