"""Bags with inertial measurements and fixes, written message by message."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.pipeline.sources.messages.ros_types import typestore

IMU, FIX = "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix"


def header(store, stamp_ns, frame):
    time = store.types["builtin_interfaces/msg/Time"](int(stamp_ns // 10**9), int(stamp_ns % 10**9))
    extra = (0,) if "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__ else ()
    return store.types["std_msgs/msg/Header"](*extra, time, frame)


def _imu_message(store, stamp_ns, rate, acceleration, frame="imu_link"):
    vector, quaternion = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Quaternion"]
    zeros = np.zeros(9)
    return store.types[IMU](
        header(store, stamp_ns, frame), quaternion(0.0, 0.0, 0.0, 1.0), zeros, vector(*rate), zeros,
        vector(*acceleration), zeros,
    )  # fmt: skip


def _fix_message(store, stamp_ns, place, status=0, variance=(1.0, 4.0, 9.0), kind=2):
    state = store.types["sensor_msgs/msg/NavSatStatus"](status, 1)
    return store.types[FIX](
        header(store, stamp_ns, "gps"), state, *map(float, place), np.diag(variance).ravel().astype(float), kind
    )


@pytest.fixture(scope="session")
def imu_message():
    return _imu_message


@pytest.fixture(scope="session")
def fix_message():
    return _fix_message


@pytest.fixture(params=["ros1", "ros2"])
def write_bag(request, tmp_path):
    """Writes `{topic: (type, [(received_ns, message of a store)])}` as a bag of either kind."""

    def write(make):
        if request.param == "ros1":
            from rosbags.rosbag1 import Writer

            store, path = typestore("ros1"), tmp_path / "log.bag"
            writer = Writer(path)
        else:
            from rosbags.rosbag2 import StoragePlugin, Writer

            store, path = typestore("cdr"), tmp_path / "log"
            writer = Writer(path, version=8, storage_plugin=StoragePlugin.MCAP)
        with writer:
            for topic, (kind, messages) in make(store).items():
                connection = writer.add_connection(topic, kind, typestore=store)
                for received_ns, message in messages:
                    raw = store.serialize_ros1(message, kind) if request.param == "ros1" else store.serialize_cdr(
                        message, kind
                    )  # fmt: skip
                    writer.write(connection, received_ns, raw)
        return path

    return write
