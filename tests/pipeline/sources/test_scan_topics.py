from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bag import BagTopic
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE
from wiclosure.pipeline.sources.salvage.found import FoundTopic
from wiclosure.pipeline.sources.scan_topics import SCAN_TYPES, choose_topic, holds_scans

BAG = Path("alpha.bag")


def topics(**found: tuple) -> dict[str, BagTopic]:
    """Topics by name, of (type, count) or (type, count, encoding)."""
    definition = MessageDefinition(MessageDefinitionFormat.MSG, "")
    return {
        f"/{name}": BagTopic(FoundTopic(f"/{name}", of[0], definition, of[2] if len(of) > 2 else "cdr"), of[1])
        for name, of in found.items()
    }


def test_the_only_topic_of_clouds_is_taken_and_empty_ones_do_not_count() -> None:
    one = topics(points=(POINT_CLOUD_TYPE, 5), empty=(POINT_CLOUD_TYPE, 0), odom=("nav_msgs/msg/Odometry", 9))
    assert choose_topic(BAG, one, None) == "/points"
    assert choose_topic(BAG, one, "points") == choose_topic(BAG, one, "/points") == "/points"


@pytest.mark.parametrize("msgtype", SCAN_TYPES)
def test_every_type_of_scans_is_known(msgtype: str) -> None:
    assert holds_scans(topics(a=(msgtype, 1))["/a"])
    assert not holds_scans(topics(a=(msgtype, 1, "protobuf"))["/a"])


@pytest.mark.parametrize(
    ("found", "requested", "says"),
    [
        ({}, None, "has no topic of point clouds (sensor_msgs/msg/PointCloud2); it is empty"),
        ({"odom": ("nav_msgs/msg/Odometry", 9)}, None, "it holds /odom (nav_msgs/msg/Odometry)"),
        ({"packets": ("velodyne_msgs/msg/VelodyneScan", 9)}, None, "(raw Velodyne packets): convert them with"),
        ({"scan": ("sensor_msgs/msg/LaserScan", 9)}, None, "(scans of a planar laser): 3D clouds are needed"),
        (
            {"a": (POINT_CLOUD_TYPE, 2), "b": (POINT_CLOUD_TYPE, 3)},
            None,
            "several topics of point clouds: /a (2 messages)",
        ),
        ({"points": (POINT_CLOUD_TYPE, 2)}, "pionts", "has no topic pionts; did you mean /points"),
        ({"points": (POINT_CLOUD_TYPE, 0)}, None, "topic /points of alpha.bag has no messages"),
        (
            {"a": (POINT_CLOUD_TYPE, 2), "odom": ("nav_msgs/msg/Odometry", 9)},
            "/odom",
            "is of type nav_msgs/msg/Odometry, not",
        ),
        ({"a": (POINT_CLOUD_TYPE, 2, "json")}, "a", "encoded as json: record it as ROS messages"),
    ],
)
def test_where_there_is_nothing_to_choose_the_way_out_is_said(found: dict, requested: str | None, says: str) -> None:
    with pytest.raises(InputError) as raised:
        choose_topic(BAG, topics(**found), requested)
    assert says in str(raised.value)
