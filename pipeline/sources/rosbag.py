"""Scans from a PointCloud2 topic of a ROS bag."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import cast

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bag_files import KINDS
from wiclosure.pipeline.sources.bags import BagTopic, open_bag
from wiclosure.pipeline.sources.messages.pointcloud2 import POINT_CLOUD_TYPE, PointCloud2Decoder, PointCloud2Message
from wiclosure.pipeline.sources.messages.ros_types import deserialize, typestore
from wiclosure.suggestions import did_you_mean
from wiclosure.types import Scan

logger = logging.getLogger(__name__)

_PACKETS = (
    "velodyne_msgs/",
    "ouster_ros/",
    "ouster_sensor_msgs/",
    "livox_ros_driver",
    "rslidar_msg",
    "hesai_ros_driver",
)


class RosbagSource:
    """A PointCloud2 topic of a ROS 1 or ROS 2 bag.

    Args:
        path: bag file or folder.
        topic: name of the topic; None takes the only one of point clouds.
        salvage: use what can be read of a bag without index or with damage.

    Raises:
        InputError: not a bag, damaged, or no such topic of point clouds, or no message on it.
    """

    def __init__(self, path: Path, topic: str | None = None, *, salvage: bool = False) -> None:
        self.path = path
        self._salvage = salvage
        with open_bag(path, salvage=salvage) as bag:
            self.topic = choose_topic(path, bag.topics, topic)
            self._count = bag.topics[self.topic].count
            self._kind = KINDS[bag.kind]

    @property
    def description(self) -> str:
        """One line for the user."""
        salvaged = ", salvaged" if self._salvage else ""
        return f"{self._kind} {self.path}, topic {self.topic}, {self._count} scans{salvaged}"

    def __len__(self) -> int:
        """Number of messages on the topic."""
        return self._count

    def __iter__(self) -> Iterator[Scan]:
        """The scans in the order of the recording."""
        decoder = PointCloud2Decoder()
        with open_bag(self.path, salvage=self._salvage) as bag:
            encoding = bag.topics[self.topic].found.encoding
            for number, (received_ns, raw) in enumerate(bag.read(self.topic)):
                try:
                    message = deserialize(typestore(encoding), encoding, raw, POINT_CLOUD_TYPE)
                    scan = decoder.decode(cast("PointCloud2Message", message), received_ns)
                except Exception as error:  # rosbags raises anything for bytes that are no such message
                    self._refuse(number, error)
                else:
                    yield scan

    def _refuse(self, number: int, error: Exception) -> None:
        """Raises for a message that cannot be decoded, or leaves it out when salvaging."""
        place = f"{self.path}, topic {self.topic}, message {number}: {error}"
        if not self._salvage:
            raise InputError(f"{place}; add --salvage to use the other messages") from error
        logger.warning("left out %s", place)


def choose_topic(path: Path, topics: Mapping[str, BagTopic], requested: str | None) -> str:
    """The topic to read: the requested one, or the only one of point clouds.

    Raises:
        InputError: there is no such topic, it has another type or no messages, or there are several to choose from.
    """
    clouds = {name: topic for name, topic in topics.items() if topic.msgtype == POINT_CLOUD_TYPE}
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


def _requested(path: Path, topics: Mapping[str, BagTopic], clouds: Mapping[str, BagTopic], requested: str) -> str:
    name = requested if requested in topics else f"/{requested.strip('/')}"
    if name not in topics:
        raise InputError(f"{path} has no topic {requested}; {did_you_mean(name, topics)}{_choices(clouds)}")
    if name not in clouds:
        raise InputError(
            f"topic {name} of {path} is of type {topics[name].msgtype}, not {POINT_CLOUD_TYPE}; {_choices(clouds)}"
        )
    return name


def _choices(clouds: Mapping[str, BagTopic]) -> str:
    return f"its point clouds: {_listed(clouds)}" if clouds else "it has no topic of point clouds"


def _listed(topics: Mapping[str, BagTopic]) -> str:
    return ", ".join(f"{name} ({topic.count} messages)" for name, topic in topics.items())


def _what_else(topics: Mapping[str, BagTopic]) -> str:
    if packets := [topic.msgtype for topic in topics.values() if topic.msgtype.startswith(_PACKETS)]:
        return f"it holds raw packets ({packets[0]}): convert them with the sensor's driver first"
    held = ", ".join(f"{topic.name} ({topic.msgtype})" for topic in topics.values())
    return f"it holds {held}" if held else "it is empty"
