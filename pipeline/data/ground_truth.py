"""Ground truth as robots bring it: files of trajectories, topics of bags, and the poses of KITTI folders."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.epochs import other_epoch
from wiclosure.formats.plausible import require_rotation
from wiclosure.formats.trajectories.kitti_poses import KittiPoses, read_kitti_poses
from wiclosure.formats.trajectories.trajectory_file import trajectory_kind
from wiclosure.pipeline.data.odometry_reader import read_poses
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.runtime.paths import is_file
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.folder import FolderSource
from wiclosure.pipeline.sources.kitti import KittiSource, is_kitti_folder
from wiclosure.pipeline.sources.open import guess_loader, open_source
from wiclosure.types import FloatArray, IntArray, Trajectory

logger = logging.getLogger(__name__)

_FURTHEST_MOUNTED_M = 100.0  # a sensor on its vehicle
_FEW = 2  # poses that may be missing at the end: a drive's last scan is often left without one


def recorded_ground_truth(robot: str, recording: RobotRecording, *, salvage: bool = False) -> Trajectory | None:
    """`T_world_body` in the robot's own clock, or None.

    Raises:
        InputError: malformed, or without overlap in time with the scans.
    """
    path = recording.ground_truth
    if path is None and recording.ground_truth_topic is None:
        return kitti_ground_truth(recording.scans, robot) if is_kitti_folder(recording.scans) else None
    if path is not None and _is_without_stamps(path):
        return _of_poses_file(path, recording, robot)
    trajectory = read_poses(robot, recording, path, recording.ground_truth_topic, salvage=salvage).trajectory
    first_ns, last_ns = _time_span(recording, salvage=salvage)
    if trajectory.stamps_ns[-1] < first_ns or trajectory.stamps_ns[0] > last_ns:
        raise InputError(
            f"ground truth {path or recording.ground_truth_topic} of {robot} covers"
            f" {_span(*trajectory.stamps_ns[[0, -1]].tolist())},"
            f" its scans {_span(first_ns, last_ns)}: they do not overlap"
            f"{_other_clock(trajectory, first_ns, last_ns)}; both must use one clock, in seconds"
        )
    return trajectory


def _is_without_stamps(path: Path) -> bool:
    """Whether a file holds poses that belong to scans by their order or number."""
    is_kitti = is_file(path) and not bag_kind(path) and trajectory_kind(path) == "kitti"
    return is_kitti and read_kitti_poses(path).stamps_ns is None


def kitti_ground_truth(folder: Path, robot: str) -> Trajectory | None:
    """`T_world_lidar` of every scan of a KITTI folder that has one, or None where it has no poses.

    Poses are `poses.txt` in the folder, or `poses/NN.txt` of the official layout.  With a `calib.txt` that has `Tr`
    (camera from LiDAR) they are the camera's, as KITTI publishes them: `T_world_lidar = Tr^-1 T_world_camera Tr`.
    Without it they are the LiDAR's already.

    Raises:
        InputError: the poses are malformed, or do not fit the scans.
    """
    official = folder.absolute().parent.parent / "poses" / f"{folder.absolute().name}.txt"
    path = next((file for file in (folder / "poses.txt", official) if file.is_file()), None)
    if path is None:
        return None
    source = KittiSource(folder)
    return _of_scans(path, source.scan_numbers, source.stamps_ns, _calibration(folder / "calib.txt"), robot)


def _of_poses_file(path: Path, recording: RobotRecording, robot: str) -> Trajectory:
    """Of a file without stamps, which belongs to the scans of a folder."""
    if bag_kind(recording.scans):
        raise InputError(
            f"{path} holds KITTI poses, which carry no stamps, and {recording.scans} is a bag; give a TUM file"
        )
    if is_kitti_folder(recording.scans):
        source = KittiSource(recording.scans)
        numbers, T_camera_lidar = source.scan_numbers, _calibration(recording.scans / "calib.txt")
        return _of_scans(path, numbers, source.stamps_ns, T_camera_lidar, robot)
    clouds = FolderSource(recording.scans, recording.layout)
    return _of_scans(path, np.arange(len(clouds)), clouds.stamps_ns, None, robot)


def _of_scans(
    path: Path, numbers: IntArray, stamps_ns: IntArray, T_camera_lidar: FloatArray | None, robot: str
) -> Trajectory:
    """Poses of a file without stamps, matched with scans of these numbers and stamps `(N,)`."""
    found = read_kitti_poses(path)
    if found.stamps_ns is None:
        scans, rows = _matched(path, numbers, found)
    else:
        scans, rows = _matched_by_stamps(path, stamps_ns, found.stamps_ns)
    T_world_lidar = found.poses[rows]
    if T_camera_lidar is not None:
        T_world_lidar = se3.inverse(T_camera_lidar) @ T_world_lidar @ T_camera_lidar
    chosen = stamps_ns[scans]
    keep = np.concatenate([[True], chosen[1:] > np.maximum.accumulate(chosen)[:-1]])  # the scans that odometry uses
    return Trajectory(robot, chosen[keep], T_world_lidar[keep])


def _matched(path: Path, numbers: IntArray, found: KittiPoses) -> tuple[IntArray, IntArray]:
    """Indices of scans and of poses that belong together.

    By the frames' numbers, where the file states them; else by order where there are as many poses as scans, by the
    scans' numbers where these are lines of the file, and by order where only the last poses are missing.

    Raises:
        InputError: nothing fits.
    """
    scans, poses = len(numbers), len(found.poses)
    if found.frames is not None:
        _, of_scans, rows = np.intersect1d(numbers, found.frames, return_indices=True)
        if len(rows):
            return of_scans, rows
    elif poses == scans:
        return np.arange(scans), np.arange(scans)
    elif numbers.max() < poses:
        return np.arange(scans), numbers
    elif 0 < scans - poses <= _FEW and poses:
        logger.warning("%s has %d poses for %d scans; the last scans have no ground truth", path, poses, scans)
        return np.arange(poses), np.arange(poses)
    raise InputError(
        f"{path} has {poses} poses for {scans} scans, the last with the number {numbers.max()}; complete it"
    )


def _matched_by_stamps(path: Path, scans_ns: IntArray, poses_ns: IntArray) -> tuple[IntArray, IntArray]:
    """Indices of scans and of the poses nearest in time, to half the time between scans.

    Raises:
        InputError: no scan has one.
    """
    after = np.searchsorted(poses_ns, scans_ns).clip(1, max(len(poses_ns) - 1, 1))
    pairs = np.stack([after - 1, np.minimum(after, len(poses_ns) - 1)])
    apart_ns = np.abs(poses_ns[pairs] - scans_ns)
    nearest = np.take_along_axis(pairs, apart_ns.argmin(axis=0)[None], axis=0)[0]
    half_ns = np.median(np.diff(np.sort(scans_ns))) / 2 if len(scans_ns) > 1 else 0
    scans = np.flatnonzero(apart_ns.min(axis=0) <= half_ns)
    if not len(scans):
        raise InputError(f"{path}: none of its stamps is that of a scan; both must use one clock")
    return scans, nearest[scans]


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
            require_rotation(f"{path}, {name.strip()}", T[:3, :3])
            if not (np.abs(T[:3, 3]) < _FURTHEST_MOUNTED_M).all():
                raise InputError(f"{path}, {name.strip()}: {T[:3, 3].tolist()} m is no place of a LiDAR on a robot")
            return T
    logger.warning("%s has no line Tr: poses are taken as those of the LiDAR", path)
    return None


def _time_span(recording: RobotRecording, *, salvage: bool) -> tuple[int, int]:
    """First and about the last stamp of the scans, without reading them all."""
    if guess_loader(recording.scans) == "rosbag":
        with open_bag(recording.scans, salvage=salvage) as bag:
            duration_ns = bag.end_ns - bag.start_ns
        first = next(iter(open_source(recording.scans, topic=recording.topic, salvage=salvage)), None)
        start_ns = first.stamp_ns if first else 0
        return start_ns, start_ns + duration_ns
    if is_kitti_folder(recording.scans):
        source: KittiSource | FolderSource = KittiSource(recording.scans)
    else:
        source = FolderSource(recording.scans, recording.layout)
    return int(source.stamps_ns.min()), int(source.stamps_ns.max())


def _other_clock(trajectory: Trajectory, first_ns: int, last_ns: int) -> str:
    """What its stamps seem to count from, in words; nothing where they fit no known epoch."""
    begin_ns, end_ns = trajectory.stamps_ns[[0, -1]].tolist()
    epoch = other_epoch(begin_ns, end_ns, first_ns, last_ns)
    return f" (its stamps fit as seconds {epoch.name}: add {-epoch.before_1970_ns // 10**9} to them)" if epoch else ""


def _span(first_ns: int, last_ns: int) -> str:
    return f"{first_ns * 1e-9:.3f} to {last_ns * 1e-9:.3f} s"
