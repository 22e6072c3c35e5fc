"""Ground truth as robots bring it: TUM files, and the poses of KITTI folders."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.tum import read_tum
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.folder import FolderSource
from wiclosure.pipeline.sources.kitti import KittiSource, is_kitti_folder, scan_numbers
from wiclosure.pipeline.sources.open import guess_loader, open_source
from wiclosure.types import FloatArray, Trajectory

_SKEWNESS = 0.01  # rotations printed with three digits stay within this of orthonormal; they are made exact


def recorded_ground_truth(robot: str, recording: RobotRecording, *, salvage: bool = False) -> Trajectory | None:
    """`T_world_body` in the robot's own clock, or None.

    Raises:
        InputError: malformed, or without overlap in time with the scans.
    """
    if recording.ground_truth is None:
        return kitti_ground_truth(recording.scans, robot) if is_kitti_folder(recording.scans) else None
    trajectory = read_tum(recording.ground_truth, robot)
    first_ns, last_ns = _time_span(recording, salvage=salvage)
    if trajectory.stamps_ns[-1] < first_ns or trajectory.stamps_ns[0] > last_ns:
        raise InputError(
            f"ground truth {recording.ground_truth} of {robot} covers {_span(*trajectory.stamps_ns[[0, -1]].tolist())},"
            f" its scans {_span(first_ns, last_ns)}: they do not overlap; both must use one clock, in seconds"
        )
    return trajectory


def kitti_ground_truth(folder: Path, robot: str) -> Trajectory | None:
    """`T_world_lidar` of every scan of a KITTI folder, or None where it has no poses.

    Poses are `poses.txt` in the folder, or `poses/NN.txt` of the official layout.  With a `calib.txt` that has `Tr`
    (camera from LiDAR) they are the camera's, as KITTI publishes them: `T_world_lidar = Tr^-1 T_world_camera Tr`.
    Without it they are the LiDAR's already.

    Raises:
        InputError: the poses are malformed, or fewer than the scans.
    """
    official = folder.absolute().parent.parent / "poses" / f"{folder.absolute().name}.txt"
    path = next((file for file in (folder / "poses.txt", official) if file.is_file()), None)
    if path is None:
        return None
    source = KittiSource(folder)
    poses = read_kitti_poses(path)
    rows = scan_numbers(source.scan_files, list(range(len(poses))), len(poses), path, "poses")
    T_camera_lidar = _calibration(folder / "calib.txt")
    T_world_lidar = poses[rows]
    if T_camera_lidar is not None:
        T_world_lidar = se3.inverse(T_camera_lidar) @ T_world_lidar @ T_camera_lidar
    latest_ns = np.maximum.accumulate(source.stamps_ns)
    keep = np.concatenate([[True], source.stamps_ns[1:] > latest_ns[:-1]])  # the scans that odometry uses
    return Trajectory(robot, source.stamps_ns[keep], T_world_lidar[keep])


def read_kitti_poses(path: Path) -> FloatArray:
    """Poses `(N, 4, 4)`: the upper three rows of each, 12 numbers a line.

    Raises:
        InputError: the file cannot be read, or a line is something else.
    """
    try:
        lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the poses {path}: {error}; check the file") from error
    poses = np.tile(np.eye(4), (len(lines), 1, 1))
    for number, words in enumerate(lines):
        try:
            poses[number, :3] = np.array(words, float).reshape(3, 4)
        except ValueError:
            raise InputError(f"{path}, line {number + 1}: expected 12 numbers (a 3 x 4 matrix), row by row") from None
        if not np.isfinite(poses[number]).all():
            raise InputError(f"{path}, line {number + 1}: not finite; expected 12 numbers (a 3 x 4 matrix)")
    R = poses[:, :3, :3]
    skewness = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2)) + (np.linalg.det(R) < 0)
    if (skewness > _SKEWNESS).any():
        raise InputError(
            f"{path}, line {np.argmax(skewness) + 1}: not a pose; expected a 3 x 4 matrix [R | t], row by row"
        )
    if len(poses):
        poses[:, :3, :3] = Rotation.from_matrix(R).as_matrix()
    return poses


def _calibration(path: Path) -> FloatArray | None:
    """`T_camera_lidar` by the line `Tr:` of a KITTI calib.txt, or None."""
    if not path.is_file():
        return None
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        name, _, numbers = line.partition(":")
        if name.strip() in {"Tr", "Tr_velo_to_cam"}:
            try:
                T = np.eye(4)
                T[:3] = np.array(numbers.split(), float).reshape(3, 4)
            except ValueError:
                raise InputError(f"{path}: {name.strip()} is not a 3 x 4 matrix of 12 numbers") from None
            return T
    return None


def _time_span(recording: RobotRecording, *, salvage: bool) -> tuple[int, int]:
    """First and about the last stamp of the scans, without reading them all."""
    if guess_loader(recording.scans) == "rosbag":
        with open_bag(recording.scans, salvage=salvage) as bag:
            duration_ns = bag.end_ns - bag.start_ns
        first = next(iter(open_source(recording.scans, topic=recording.topic, salvage=salvage)), None)
        start_ns = first.stamp_ns if first else 0
        return start_ns, start_ns + duration_ns
    source = KittiSource(recording.scans) if is_kitti_folder(recording.scans) else FolderSource(recording.scans)
    return int(source.stamps_ns.min()), int(source.stamps_ns.max())


def _span(first_ns: int, last_ns: int) -> str:
    return f"{first_ns * 1e-9:.3f} to {last_ns * 1e-9:.3f} s"
