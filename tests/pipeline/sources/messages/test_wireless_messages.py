from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.ros_types import (
    HEADING_TYPE,
    MEASUREMENT_TYPE,
    deserialize,
    serialize,
    typestore,
)
from wiclosure.pipeline.sources.messages.wireless_messages import (
    decode_heading,
    decode_measurement,
    encode_heading,
    encode_measurement,
)
from wiclosure.types import AoaPath, Heading, WirelessMeasurement

ANGLES, SIGMAS, METRES = st.floats(-3.1, 3.1), st.floats(1e-3, 1.0), st.floats(-5.0, 5.0)
STAMPS_NS = st.integers(0, 2**31 * 10**9 - 1)
PATHS = st.builds(AoaPath, ANGLES, SIGMAS, st.floats(0.0, 1.0, exclude_min=True), st.none() | st.floats(-1.5, 1.5))
ARMS = st.tuples(METRES, METRES, METRES)
MEASUREMENTS = st.builds(
    WirelessMeasurement,
    STAMPS_NS,
    st.just("alpha"),
    st.just("beta"),
    st.floats(0.0, 500.0),
    SIGMAS,
    st.lists(PATHS, max_size=4).map(tuple),
    st.sampled_from(["body", "odometry", "world"]),
    transmitter_stamp_ns=st.none() | STAMPS_NS,
    lever_arm_receiver=ARMS,
    lever_arm_transmitter=ARMS,
)


def through_bytes(encoding, encode, decode, value, msgtype):
    store = typestore(encoding)
    raw = bytes(serialize(store, encoding, encode(value, store), msgtype))
    return decode(deserialize(store, encoding, raw, msgtype))


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@given(measurement=MEASUREMENTS)
def test_a_measurement_is_read_back_to_the_last_digit(encoding, measurement):
    found = through_bytes(encoding, encode_measurement, decode_measurement, measurement, MEASUREMENT_TYPE)
    assert found == measurement


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_a_bearing_without_a_range_has_none_afterwards_too(encoding):
    bearing = WirelessMeasurement(5, "alpha", "beta", None, None, (AoaPath(0.5, 0.1),))
    found = through_bytes(encoding, encode_measurement, decode_measurement, bearing, MEASUREMENT_TYPE)
    assert found == bearing
    assert found.range_m is None


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@given(heading=st.builds(Heading, STAMPS_NS, st.just("alpha"), ANGLES, SIGMAS))
def test_a_heading_is_read_back(encoding, heading):
    assert through_bytes(encoding, encode_heading, decode_heading, heading, HEADING_TYPE) == heading


def test_axes_that_nobody_knows_are_refused_and_none_are_the_bodys():
    store = typestore("cdr")
    message = encode_measurement(WirelessMeasurement(5, "alpha", "beta", 1.0, 0.1), store)
    message.aoa_frame = ""
    assert decode_measurement(message).aoa_frame == "body"
    message.aoa_frame = "antenna"
    with pytest.raises(InputError, match="aoa_frame is 'antenna'; expected body, odometry or world"):
        decode_measurement(message)
