"""ROS message types: which rosbags type store reads and writes what."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition
    from rosbags.typesys.store import Typestore

Encoding: TypeAlias = Literal["ros1", "cdr"]
"""How messages are encoded: of ROS 1, and of ROS 2."""

POINT_CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"

MEASUREMENT_TYPE = "wiclosure_msgs/msg/WirelessMeasurement"
HEADING_TYPE = "wiclosure_msgs/msg/Heading"
PATH_TYPE = "wiclosure_msgs/msg/AoaPath"

MESSAGE_PACKAGE = files("wiclosure.formats") / "wiclosure_msgs"
"""The ROS 2 package of these messages, as it is built in a workspace."""

DEFINITIONS: Mapping[str, str] = {
    msgtype: (MESSAGE_PACKAGE / "msg" / f"{msgtype.rpartition('/')[2]}.msg").read_text(encoding="utf-8")
    for msgtype in (PATH_TYPE, MEASUREMENT_TYPE, HEADING_TYPE)
}

DRACO_TYPE = "point_cloud_interfaces/msg/CompressedPointCloud2"
_DRACO_DEFINITION = """std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] compressed_data
bool is_dense
string format
"""
_TRANSFORMS = dict.fromkeys(
    ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"), "geometry_msgs/TransformStamped[] transforms\n"
)


@cache
def typestore(encoding: Encoding) -> Typestore:
    """The message types of ROS 1 (`ros1`) or ROS 2 (`cdr`), ours included."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if encoding == "ros1" else Stores.ROS2_HUMBLE)
    for msgtype, definition in {**DEFINITIONS, DRACO_TYPE: _DRACO_DEFINITION, **_TRANSFORMS}.items():
        if msgtype not in store.types:
            store.register(get_types_from_msg(definition, msgtype))
    return store


@cache
def recorded_typestore(encoding: Encoding, msgtype: str, definition: MessageDefinition) -> Typestore:
    """The types by which a bag's own messages are read: its definition where it has one, else the usual one.

    Definitions differ between ROS versions (`sensor_msgs/Range` has gained a field); that of PointCloud2 never has, and
    is not parsed.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    stated = definition.format == MessageDefinitionFormat.MSG and definition.data.strip()
    if msgtype == POINT_CLOUD_TYPE or not stated:
        return typestore(encoding)
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(definition.data, msgtype))
    except TypesysError:
        return typestore(encoding)
    return store


def deserialize(store: Typestore, encoding: Encoding, raw: bytes, msgtype: str) -> object:
    """The message in `raw`."""
    view = memoryview(raw)  # parts of which are no copies
    return store.deserialize_ros1(view, msgtype) if encoding == "ros1" else store.deserialize_cdr(view, msgtype)


def serialize(store: Typestore, encoding: Encoding, message: object, msgtype: str) -> memoryview:
    """The bytes of a message."""
    return store.serialize_ros1(message, msgtype) if encoding == "ros1" else store.serialize_cdr(message, msgtype)
