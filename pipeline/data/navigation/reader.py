"""Reads a robot's inertial measurements and positions on the Earth from wherever they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.pipeline.data.inputs import GnssInput, ImuInput
from wiclosure.pipeline.data.navigation.imu_units import converted
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.navigation.gnss_topics import FIX_TYPE, read_fix_topic
from wiclosure.pipeline.sources.navigation.imu_topics import IMU_TYPE, ImuReading, read_imu_topic
from wiclosure.pipeline.sources.navigation.oxts import oxts_folder, read_oxts_gnss, read_oxts_imu
from wiclosure.pipeline.sources.navigation.tables import read_gnss_table, read_imu_table
from wiclosure.pipeline.sources.poses.mounting import lidar_mount
from wiclosure.types import FloatArray, GnssLog


def read_imu(robot: str, recording: RobotRecording, *, salvage: bool = False) -> tuple[ImuInput | None, list[str]]:
    """The measurements, or None; and sentences on what is there and not used.

    What the data set names must be readable; what was only found beside the scans is left out with a sentence.

    Raises:
        InputError: what the data set names cannot be read; names the robot as well.
    """
    named = recording.imu is not None or recording.imu_topic is not None
    try:
        reading, remark = _imu_reading(recording, salvage=salvage)
        if reading is None:
            return None, [f"{robot}: {remark}"] if remark else []
        T = _mounting(recording, reading, salvage=salvage)
    except InputError as error:
        if named:
            raise InputError(f"robot {robot}: {error}") from error
        return None, [f"{robot}: its IMU is left out: {error}"]
    log = converted(reading.log, recording.imu_units)
    offset_ns = recording.time_offset_ns + round(recording.imu_time_offset * 1e9)
    return ImuInput(replace(log, stamps_ns=log.stamps_ns + offset_ns), T), []


def _imu_reading(recording: RobotRecording, *, salvage: bool) -> tuple[ImuReading | None, str]:
    """What is named, or the only one beside the scans."""
    place, topic = recording.imu or recording.scans, recording.imu_topic
    if bag_kind(place):
        if topic is None:
            with open_bag(place, salvage=salvage) as bag:
                topics = bag.topics_of(IMU_TYPE)
            if len(topics) > 1:
                return None, f"its bag has the IMU topics {', '.join(topics)}; name one with imu_topic to use it"
            topic = topics[0] if topics else None
        return (read_imu_topic(place, topic, salvage=salvage) if topic else None), ""
    if topic is not None:
        raise InputError(f"{place} is no bag, so it has no topic {topic}; name a table, or a bag beside the topic")
    if place.is_dir():
        folder = oxts_folder(place)
        if folder is None and recording.imu is not None:
            raise InputError(f"{place} is neither a bag nor a folder of OXTS files (data/*.txt, timestamps.txt)")
        return (read_oxts_imu(folder) if folder else None), ""
    return (ImuReading(read_imu_table(place)) if recording.imu is not None else None), ""


def _mounting(recording: RobotRecording, reading: ImuReading, *, salvage: bool) -> FloatArray | None:
    """`T_lidar_imu (4, 4)` as the data set states it, as the source does, or by static transforms in the bags."""
    if recording.imu_pose is not None:
        R = Rotation.from_quat(recording.imu_pose[3:]).as_matrix()
        return se3.from_rotation_translation(R, np.array(recording.imu_pose[:3]))
    if reading.T_lidar_imu is not None or not reading.frame or not bag_kind(recording.scans):
        return reading.T_lidar_imu
    mount = lidar_mount(recording.scans, recording.topic, reading.frame, recording.imu, salvage=salvage)
    if mount.frame == reading.frame:
        return None  # drivers name their IMU like their LiDAR, whose axes it may not have
    return None if mount.T_body_lidar is None else se3.inverse(mount.T_body_lidar)


def read_gnss(robot: str, recording: RobotRecording, *, salvage: bool = False) -> tuple[GnssInput | None, list[str]]:
    """The positions that the data set names, or None; and a sentence where the bag has some that it does not name.

    Raises:
        InputError: they cannot be read; names the robot as well.
    """
    if recording.gnss is None and recording.gnss_topic is None:
        return None, _unused_fixes(robot, recording.scans, salvage=salvage)
    try:
        log = _gnss_log(recording.gnss or recording.scans, recording.gnss_topic, salvage=salvage)
    except InputError as error:
        raise InputError(f"robot {robot}: {error}") from error
    log = replace(log, stamps_ns=log.stamps_ns + recording.time_offset_ns)
    return GnssInput(log, np.array(recording.gnss_antenna or (0.0, 0.0, 0.0))), []


def _gnss_log(place: Path, topic: str | None, *, salvage: bool) -> GnssLog:
    if bag_kind(place):
        if topic is None:
            with open_bag(place, salvage=salvage) as bag:
                topics = bag.topics_of(FIX_TYPE)
            if len(topics) != 1:
                raise InputError(f"{place}: name the topic of positions; there are: {', '.join(topics) or 'none'}")
            topic = topics[0]
        return read_fix_topic(place, topic, salvage=salvage)
    if topic is not None:
        raise InputError(f"{place} is no bag, so it has no topic {topic}; name a table, or a bag beside the topic")
    folder = oxts_folder(place) if place.is_dir() else None
    return read_gnss_table(place) if folder is None else read_oxts_gnss(folder)


def _unused_fixes(robot: str, scans: Path, *, salvage: bool) -> list[str]:
    if not bag_kind(scans):
        return []
    with open_bag(scans, salvage=salvage) as bag:
        topics = bag.topics_of(FIX_TYPE)
    return [f"{robot}: its bag has GNSS on {t}; gnss_topic: {t} in a dataset.yaml places the map" for t in topics[:1]]
