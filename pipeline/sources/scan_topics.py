"""Which topic of a bag holds the scans."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bag import BagTopic, topic_name
from wiclosure.pipeline.sources.messages.livox import LIVOX_TYPES
from wiclosure.pipeline.sources.messages.ros_types import DRACO_TYPE, POINT_CLOUD_TYPE
from wiclosure.suggestions import did_you_mean

SCAN_TYPES = (POINT_CLOUD_TYPE, *LIVOX_TYPES, DRACO_TYPE)

# What looks like scans and cannot be read: the beginning of the type, what it is, and the way out.
_UNREADABLE: Mapping[str, tuple[str, str]] = {
    "velodyne_msgs/": ("raw Velodyne packets", "convert them with velodyne_pointcloud (its transform node)"),
    "ouster_ros/": ("raw Ouster packets", "replay them through ouster_ros and record its points topic"),
    "ouster_sensor_msgs/": ("raw Ouster packets", "replay them through ouster_ros and record its points topic"),
    "rslidar_msg": ("raw RoboSense packets", "replay them through rslidar_sdk and record its points topic"),
    "hesai_ros_driver": ("raw Hesai packets", "replay them through hesai_ros_driver and record its points topic"),
    "pandar_msgs/": ("raw Hesai packets", "replay them through the Hesai driver and record its points topic"),
    "nebula_msgs/": ("raw packets", "replay them through nebula and record its points topic"),
    "livox_interfaces/msg/LivoxPacket": ("raw Livox packets", "replay them through the Livox driver"),
    "sensor_msgs/msg/PointCloud": (
        "clouds of the old type PointCloud",
        "convert them to PointCloud2 with point_cloud_converter",
    ),
    "sensor_msgs/msg/LaserScan": ("scans of a planar laser", "3D clouds are needed"),
    "sensor_msgs/msg/MultiEchoLaserScan": ("scans of a planar laser", "3D clouds are needed"),
    "foxglove": ("Foxglove messages", "record sensor_msgs/PointCloud2 instead"),
}


def choose_topic(path: Path, topics: Mapping[str, BagTopic], requested: str | None) -> str:
    """The topic to read: the requested one, or the only one of point clouds.

    Raises:
        InputError: there is no such topic, it has another type or no messages, or there are several to choose from.
    """
    clouds = {name: topic for name, topic in topics.items() if holds_scans(topic)}
    if requested is not None:
        name = _requested(path, topics, clouds, requested)
    elif not clouds:
        raise InputError(f"{path} has no topic of point clouds ({POINT_CLOUD_TYPE}); {_what_else(topics)}")
    else:
        filled = [name for name, topic in clouds.items() if topic.count] or list(clouds)
        if len(filled) > 1:
            raise InputError(
                f"{path} has several topics of point clouds: {_listed(clouds)}; choose one with --topic,"
                " or for each robot in a dataset.yaml"
            )
        name = filled[0]
    if topics[name].count == 0:
        raise InputError(f"topic {name} of {path} has no messages; {_choices(clouds)}")
    return name


def holds_scans(topic: BagTopic) -> bool:
    """Whether the topic's messages can be read as scans."""
    return topic.is_ros and topic.msgtype in SCAN_TYPES


def _requested(path: Path, topics: Mapping[str, BagTopic], clouds: Mapping[str, BagTopic], requested: str) -> str:
    name = topic_name(topics, requested)
    if name not in topics:
        raise InputError(f"{path} has no topic {requested}; {did_you_mean(name, topics)}{_choices(clouds)}")
    if name not in clouds:
        kind = (
            topics[name].msgtype if topics[name].is_ros else f"{topics[name].msgtype} as {topics[name].found.encoding}"
        )
        raise InputError(
            f"topic {name} of {path} is of type {kind}, not {POINT_CLOUD_TYPE}"
            f"{_why_not(topics[name])}; {_choices(clouds)}"
        )
    return name


def _choices(clouds: Mapping[str, BagTopic]) -> str:
    return f"its point clouds: {_listed(clouds)}" if clouds else "it has no topic of point clouds"


def _listed(topics: Mapping[str, BagTopic]) -> str:
    return ", ".join(f"{name} ({topic.count} messages)" for name, topic in topics.items())


def _what_else(topics: Mapping[str, BagTopic]) -> str:
    for topic in topics.values():
        if why := _why_not(topic):
            return f"{topic.name} is {topic.msgtype}{why}"
    held = ", ".join(f"{topic.name} ({topic.msgtype})" for topic in topics.values())
    return f"it holds {held}" if held else "it is empty"


def _why_not(topic: BagTopic) -> str:
    """What a topic is that looks like scans, and the way out; nothing for others."""
    if topic.msgtype in SCAN_TYPES and not topic.is_ros:
        return f", encoded as {topic.found.encoding}: record it as ROS messages"
    found = next((words for start, words in _UNREADABLE.items() if topic.msgtype.startswith(start)), None)
    return f" ({found[0]}): {found[1]}" if found else ""
