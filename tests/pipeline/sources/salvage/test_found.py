from __future__ import annotations

import logging

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from wiclosure.pipeline.sources.salvage.found import Damage, FoundTopic, everything


def topic(definition=""):
    return FoundTopic("/a", "std_msgs/msg/Empty", MessageDefinition(MessageDefinitionFormat.MSG, definition), "cdr")


def test_the_first_damages_are_remembered_and_all_are_logged(caplog):
    damage = Damage()
    assert damage.found == []
    with caplog.at_level(logging.INFO):
        for number in range(5):
            damage(f"record {number} is cut off: 100 % of it")
    assert damage.found == [f"record {number} is cut off: 100 % of it" for number in range(3)]
    assert len(caplog.messages) == 5


def test_files_do_not_share_their_damage():
    first, second = Damage(), Damage()
    first("a chunk does not decompress")
    assert second.found == []


def test_topics_can_be_counted_by_all_that_is_said_of_them():
    assert len({topic(), topic(), topic("uint8 data")}) == 2
    assert everything(topic())
