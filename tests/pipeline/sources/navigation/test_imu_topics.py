"""Inertial measurements of bags, ROS 1 and ROS 2."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.navigation.imu_topics import read_imu_topic

IMU, START_NS = "sensor_msgs/msg/Imu", 1_700_000_000 * 10**9
RNG = np.random.default_rng(0)
RATE, ACCELERATION = RNG.normal(size=(200, 3)), RNG.normal(size=(200, 3))
STAMPS_NS = START_NS + np.arange(200, dtype=np.int64) * 5_000_123


@pytest.fixture
def messages(imu_message):
    def make(store, frame="imu_link", acceleration=ACCELERATION):
        rows = zip(STAMPS_NS.tolist(), RATE.tolist(), acceleration.tolist(), strict=True)
        return [(ns + 1_000_000, imu_message(store, ns, rate, felt, frame)) for ns, rate, felt in rows]

    return make


@pytest.mark.parametrize("frame", ["imu_link", "", "x", "a/long/frame/of_the_imu"])
def test_all_samples_to_the_last_digit(write_bag, messages, frame):
    path = write_bag(lambda store: {"/imu/data": (IMU, messages(store, frame))})
    reading = read_imu_topic(path, "/imu/data")
    np.testing.assert_array_equal(reading.log.stamps_ns, STAMPS_NS)
    np.testing.assert_array_equal(reading.log.turning_rate, RATE)
    np.testing.assert_array_equal(reading.log.acceleration, ACCELERATION)
    assert reading.frame == frame


def test_what_holds_no_numbers_is_left_out_and_counted(write_bag, messages, caplog):
    spoiled = ACCELERATION.copy()
    spoiled[[3, 90]] = np.nan
    path = write_bag(lambda store: {"/imu": (IMU, messages(store, acceleration=spoiled))})
    with caplog.at_level(logging.WARNING):
        assert len(read_imu_topic(path, "imu").log) == 198
    assert "2 of 200 messages hold no numbers" in caplog.text


def test_another_topic_is_named(write_bag, messages):
    path = write_bag(lambda store: {"/imu": (IMU, messages(store))})
    with pytest.raises(InputError, match=r"no messages of .* on /odom; topics that have: /imu"):
        read_imu_topic(path, "/odom")


def test_of_two_imus_in_one_topic_the_one_with_more_samples_is_used(write_bag, imu_message, caplog):
    def both(store):
        rows = zip(STAMPS_NS.tolist(), RATE.tolist(), ACCELERATION.tolist(), strict=True)
        frames = ["base_imu" if n % 5 < 2 else "lidar_imu" for n in range(200)]
        return [(row[0], imu_message(store, *row, frame)) for row, frame in zip(rows, frames, strict=True)]

    with caplog.at_level(logging.WARNING):
        reading = read_imu_topic(write_bag(lambda store: {"/imu": (IMU, both(store))}), "/imu")
    assert reading.frame == "lidar_imu"
    np.testing.assert_array_equal(reading.log.acceleration, ACCELERATION[np.arange(200) % 5 >= 2])
    assert "frames lidar_imu, base_imu; only the 120 of lidar_imu are used" in caplog.text
