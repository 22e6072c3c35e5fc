from __future__ import annotations

from dataclasses import replace

import pytest

from wiclosure.pipeline.radio.unused import UnusedRadio
from wiclosure.pipeline.sources.wireless_topics import RANGE_TYPE

ONE = UnusedRadio("/uwb", ("/uwb",), "lab_msgs/msg/Uwb", 12, "", (), None)


@pytest.mark.parametrize(
    ("radio", "others", "says"),
    [
        (
            ONE,
            [],
            "12 lab_msgs/Uwb messages on /uwb are not used: if it is a radio's, add to wireless:"
            " {topic: /uwb, range: FIELD, from: FIELD, to: FIELD}",
        ),
        (
            replace(ONE, preset="linktrack"),
            [],
            "12 lab_msgs/Uwb messages on /uwb are not used: add to wireless: {topic: /uwb, robots: {ID: NAME}}"
            " (preset linktrack)",
        ),
        (
            replace(ONE, msgtype=RANGE_TYPE, frame_id="tag"),
            ["beta", "gamma"],
            "12 sensor_msgs/Range messages on /uwb are not used: frame_id 'tag' names no pair of robots; if it is a"
            " radio's, add ranges: {/uwb: beta} to the robot",
        ),
        (
            replace(ONE, msgtype=RANGE_TYPE),
            [],
            "12 sensor_msgs/Range messages on /uwb are not used: no robots are named; if it is a radio's, add ranges:"
            " {/uwb: NAME} to the robot",
        ),
        (
            replace(ONE, topic="/n{from}/n{to}", topics=("/n1/n2", "/n2/n1"), ids=("1", "2")),
            [],
            "12 lab_msgs/Uwb messages on /n{from}/n{to} are not used (2 topics, ids 1, 2); add to wireless:"
            " {topic: '/n{from}/n{to}', robots: {ID: NAME}}",
        ),
    ],
)
def test_each_kind_says_what_to_add(radio: UnusedRadio, others: list[str], says: str) -> None:
    assert radio.sentence(others) == says
