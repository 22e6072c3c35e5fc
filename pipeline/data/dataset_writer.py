"""Writes scans and wireless measurements as the recordings that users bring: ROS 1 and ROS 2 bags, KITTI folders.

Scans are taken one at a time from any iterable.  A recording appears whole or not at all.
"""

from __future__ import annotations

import heapq
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from wiclosure.errors import OutputError
from wiclosure.formats.stamps import seconds_text
from wiclosure.formats.trajectories.kitti_poses import write_kitti_poses
from wiclosure.pipeline.runtime.output import whole_folder
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import (
    HEADING_TYPE,
    MEASUREMENT_TYPE,
    POINT_CLOUD_TYPE,
    Encoding,
    serialize,
    typestore,
)
from wiclosure.pipeline.sources.messages.wireless_messages import encode_heading, encode_measurement
from wiclosure.scratch import unfinished_folder
from wiclosure.types import FloatArray, Scan, WirelessLog

Storage: TypeAlias = Literal["mcap", "sqlite3"]

POINTS_TOPIC = "/points"
WIRELESS_TOPIC = "/wireless"
HEADING_TOPIC = "/heading"
_LATEST_ROS_NS = 2**31 * 10**9  # a ROS time has 31 bits for the seconds

_Message: TypeAlias = tuple[int, str, memoryview]  # stamp, topic, serialised
_Write: TypeAlias = Callable[[int, str, memoryview], None]
_AddTopic: TypeAlias = Callable[[str, str], None]


def write_ros1_bag(
    path: Path | str, scans: Iterable[Scan], topic: str = POINTS_TOPIC, *, wireless: WirelessLog | None = None
) -> None:
    """Writes a ROS 1 bag, scans and wireless messages interleaved by time.

    Args:
        path: the `.bag` file; must not exist.
        scans: in order of time; float32 `x y z`, `intensity` and `time` (s after the stamp) where they have them.
        topic: name of the PointCloud2 topic.
        wireless: written on `/wireless` and `/heading`, where it has such.

    Raises:
        OutputError: the file exists or cannot be written, or a stamp does not fit ROS.
    """
    from rosbags.rosbag1 import Writer

    with _aside(Path(path)) as scratch, Writer(scratch) as writer:
        connections = {
            name: writer.add_connection(name, msgtype, typestore=typestore("ros1"))
            for name, msgtype in _topics(topic, wireless)
        }
        for stamp_ns, name, raw in _messages(scans, topic, wireless, "ros1"):
            writer.write(connections[name], stamp_ns, raw)


def write_ros2_bag(
    path: Path | str,
    scans: Iterable[Scan],
    topic: str = POINTS_TOPIC,
    *,
    storage: Storage = "mcap",
    wireless: WirelessLog | None = None,
) -> None:
    """Writes a ROS 2 bag folder, scans and wireless messages interleaved by time.

    Args:
        path: the folder; must not exist.
        scans: see `write_ros1_bag`.
        topic: name of the PointCloud2 topic.
        storage: `mcap` or `sqlite3`.
        wireless: see `write_ros1_bag`.

    Raises:
        OutputError: see `write_ros1_bag`.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with _aside(Path(path)) as scratch, Writer(scratch, version=8, storage_plugin=plugin) as writer:
        connections = {
            name: writer.add_connection(name, msgtype, typestore=typestore("cdr"))
            for name, msgtype in _topics(topic, wireless)
        }
        for stamp_ns, name, raw in _messages(scans, topic, wireless, "cdr"):
            writer.write(connections[name], stamp_ns, raw)


def write_kitti_folder(path: Path | str, scans: Iterable[Scan], *, T_world_lidar: FloatArray | None = None) -> None:
    """Writes a KITTI-odometry-like folder: `velodyne/*.bin`, `times.txt`, and `poses.txt` (LiDAR frame) where known.

    Args:
        path: the folder; must not exist.
        scans: in order of time; per-point times have no place in this format.
        T_world_lidar: `(N, 4, 4)` pose of each scan, or None.

    Raises:
        OutputError: the folder exists or cannot be written, or poses and scans differ in number.
    """
    with whole_folder(Path(path)) as scratch:
        (scratch / "velodyne").mkdir()
        stamps_ns = []
        for number, scan in enumerate(scans):
            rows = np.zeros((len(scan.points), 4), "<f4")
            rows[:, :3] = scan.points
            if scan.intensity is not None:
                rows[:, 3] = scan.intensity
            (scratch / "velodyne" / f"{number:06d}.bin").write_bytes(rows.tobytes())
            stamps_ns.append(scan.stamp_ns)
        (scratch / "times.txt").write_text("".join(f"{text}\n" for text in seconds_text(stamps_ns)))
        if T_world_lidar is not None:
            if len(T_world_lidar) != len(stamps_ns):
                raise OutputError(f"{path}: {len(T_world_lidar)} poses for {len(stamps_ns)} scans; give one each")
            write_kitti_poses(scratch / "poses.txt", T_world_lidar)


def _topics(topic: str, wireless: WirelessLog | None) -> list[tuple[str, str]]:
    """Topic names and types to write."""
    topics = [(topic, POINT_CLOUD_TYPE)]
    if wireless is not None and wireless.measurements:
        topics.append((WIRELESS_TOPIC, MEASUREMENT_TYPE))
    if wireless is not None and wireless.headings:
        topics.append((HEADING_TOPIC, HEADING_TYPE))
    return topics


def _messages(
    scans: Iterable[Scan], topic: str, wireless: WirelessLog | None, encoding: Encoding
) -> Iterator[_Message]:
    """Everything to write, serialised, in order of time."""
    store = typestore(encoding)
    log = wireless or WirelessLog()
    clouds = (
        (ros_stamp_ns(scan.stamp_ns), topic, serialize(store, encoding, encode_scan(scan, store), POINT_CLOUD_TYPE))
        for scan in scans
    )
    measurements = (
        (
            ros_stamp_ns(m.stamp_ns),
            WIRELESS_TOPIC,
            serialize(store, encoding, encode_measurement(m, store), MEASUREMENT_TYPE),
        )
        for m in log.measurements
    )
    headings = (
        (ros_stamp_ns(h.stamp_ns), HEADING_TOPIC, serialize(store, encoding, encode_heading(h, store), HEADING_TYPE))
        for h in log.headings
    )
    return heapq.merge(clouds, measurements, headings, key=lambda message: message[0])


def ros_stamp_ns(stamp_ns: int) -> int:
    """The stamp, where ROS can express it."""
    if not 0 <= stamp_ns < _LATEST_ROS_NS:
        raise OutputError(f"stamp {stamp_ns * 1e-9:.9f} s does not fit a ROS time; shift the recording to 1970-2038")
    return stamp_ns


@contextmanager
def _aside(path: Path) -> Iterator[Path]:
    """Gives a path of the same name in a scratch folder; it becomes `path` when the block ends well.

    Of the same name, because a ROS 2 bag names its files after its folder.
    """
    if path.exists():
        raise OutputError(f"{path} exists already; choose another place or remove it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = unfinished_folder(path.parent)
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({error.strerror}); choose another place") from error
    try:
        yield folder / path.name
        (folder / path.name).rename(path)
    except OSError as error:
        raise OutputError(f"writing {path} failed ({error.strerror}); nothing unfinished stays") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
