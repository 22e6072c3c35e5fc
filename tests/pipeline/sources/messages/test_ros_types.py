from __future__ import annotations

import pytest
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.typesys import get_types_from_msg

from wiclosure.pipeline.sources.messages.ros_types import (
    DRACO_TYPE,
    MEASUREMENT_TYPE,
    POINT_CLOUD_TYPE,
    deserialize,
    recorded_typestore,
    serialize,
    typestore,
)

ENCODINGS = ["ros1", "cdr"]


def defined(text: str) -> MessageDefinition:
    return MessageDefinition(MessageDefinitionFormat.MSG, text)


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("msgtype", [MEASUREMENT_TYPE, DRACO_TYPE, "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"])
def test_types_that_ros_does_not_bring_are_known(encoding, msgtype):
    assert msgtype in typestore(encoding).types


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_a_bags_own_definition_counts(encoding):
    """`sensor_msgs/Range` of this bag has one field only, whatever ROS has now."""
    definition = defined("float32 range\n")
    store = recorded_typestore(encoding, "sensor_msgs/msg/Range", definition)
    assert [name for name, _ in store.fielddefs["sensor_msgs/msg/Range"][1]] == ["range"]
    message = store.types["sensor_msgs/msg/Range"](range=2.5)
    raw = bytes(serialize(store, encoding, message, "sensor_msgs/msg/Range"))
    assert deserialize(store, encoding, raw, "sensor_msgs/msg/Range").range == 2.5


@pytest.mark.parametrize("text", ["", "  \n", "% % %"])
def test_without_one_that_can_be_read_the_usual_types_count(text):
    assert recorded_typestore("cdr", "sensor_msgs/msg/Range", defined(text)) is typestore("cdr")


def test_that_of_point_clouds_is_not_parsed():
    definition = defined("uint8[] something\n")
    assert recorded_typestore("cdr", POINT_CLOUD_TYPE, definition) is typestore("cdr")


def test_definitions_of_other_types_in_the_text_are_registered_too():
    text = "lab_msgs/Node[] nodes\n" + "=" * 80 + "\nMSG: lab_msgs/Node\nfloat32 dis\n"
    store = recorded_typestore("cdr", "lab_msgs/msg/Uwb", defined(text))
    assert {"lab_msgs/msg/Uwb", "lab_msgs/msg/Node"} <= set(store.types)
    assert set(get_types_from_msg(text, "lab_msgs/msg/Uwb")) <= set(store.types)
