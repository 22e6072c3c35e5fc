from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.messages.headers import nanoseconds_of
from wiclosure.pipeline.sources.scan_messages import ScanDecoder, ScanMessages


@pytest.fixture(params=["ros1", "mcap", "sqlite3"])
def topic_and_raw(request, bags):
    with open_bag(bags[request.param]) as bag:
        yield bag.topics["/points"], [raw for _, raw in bag.read("/points")]


def test_headers_are_read_before_points(topic_and_raw, scans):
    topic, raw = topic_and_raw
    message = ScanMessages(topic)(raw[2], 2)
    assert (message.number, message.stamp_ns, message.frame_id) == (2, scans[2].stamp_ns, "lidar")
    assert nanoseconds_of(message.content.header.stamp) == scans[2].stamp_ns


def test_points_are_decoded_with_the_stamp_that_is_to_be_used(topic_and_raw, scans):
    topic, raw = topic_and_raw
    scan = ScanDecoder(topic, "a bag").decode(ScanMessages(topic)(raw[1], 1), 77)
    assert scan.stamp_ns == 77
    np.testing.assert_array_equal(scan.points, scans[1].points)
    np.testing.assert_array_equal(scan.intensity, scans[1].intensity)
    np.testing.assert_allclose(scan.times, scans[1].times, atol=1e-9)


def test_bytes_that_are_no_message_raise(topic_and_raw):
    topic, raw = topic_and_raw
    with pytest.raises(Exception):  # noqa: B017, PT011  -- rosbags raises anything
        ScanMessages(topic)(raw[0][:10], 0)


def test_a_cloud_with_fewer_bytes_than_its_header_says_is_refused(topic_and_raw):
    topic, raw = topic_and_raw
    message = ScanMessages(topic)(raw[0], 0)
    message.content.data = message.content.data[:-20]
    with pytest.raises(InputError):
        ScanDecoder(topic, "a bag").decode(message, 1)
