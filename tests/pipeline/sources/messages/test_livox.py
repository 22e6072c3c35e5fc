"""Livox's CustomMsg, against rosbags' own serialisation of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.info import recording_info
from wiclosure.pipeline.sources.messages.livox import LivoxDecoder, livox_header
from wiclosure.pipeline.sources.open import open_source

POINT = "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line\n"
MESSAGE = (
    "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\nCustomPoint[] points\n"
)
STAMP_NS = 1_700_000_000_123_456_789


def message(
    package: str, ros: str, frame: str = "livox_frame", count: int = 50, step_ns: int = 400_000
) -> tuple[Any, bytes, np.ndarray]:
    """The type store, the serialised message, and what is in it."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == "ros1" else Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(POINT, f"{package}/msg/CustomPoint"))
    store.register(get_types_from_msg(MESSAGE, f"{package}/msg/CustomMsg"))
    rows = np.random.default_rng(count).uniform(1, 50, (count, 3)).astype(np.float32)
    rows[3:5] = 0  # no return
    point, types = store.types[f"{package}/msg/CustomPoint"], store.types
    points = [point(k * step_ns, *map(float, row), k, 16, k % 6) for k, row in enumerate(rows)]
    stamp = types["builtin_interfaces/msg/Time"](sec=STAMP_NS // 10**9, nanosec=STAMP_NS % 10**9)
    header = types["std_msgs/msg/Header"](**({"seq": 0} if ros == "ros1" else {}), stamp=stamp, frame_id=frame)
    made = types[f"{package}/msg/CustomMsg"](header, STAMP_NS, count, 1, np.zeros(3, np.uint8), points)
    serialize = store.serialize_ros1 if ros == "ros1" else store.serialize_cdr
    return store, bytes(serialize(made, f"{package}/msg/CustomMsg")), rows


@pytest.mark.parametrize("ros", ["ros1", "cdr"])
@pytest.mark.parametrize("frame", ["", "a", "livox_frame", "seven77"])
def test_points_times_and_reflectivity(ros: Any, frame: str) -> None:
    _, raw, rows = message("livox_ros_driver2", ros, frame)
    assert livox_header(raw, ros) == (STAMP_NS, frame)
    scan = LivoxDecoder().decode(raw, ros, STAMP_NS)
    kept = np.setdiff1d(np.arange(50), [3, 4])
    np.testing.assert_array_equal(scan.points, rows[kept])
    np.testing.assert_allclose(scan.times, kept * 4e-4, atol=1e-12)
    np.testing.assert_array_equal(scan.intensity, kept)


def test_points_that_a_simulator_did_not_time_are_said_once(caplog: pytest.LogCaptureFixture) -> None:
    _, raw, _ = message("livox_ros_driver2", "cdr", step_ns=0)
    decoder = LivoxDecoder("a.mcap")
    for _ in range(2):
        decoder.decode(raw, "cdr", STAMP_NS)
    assert caplog.messages == ["a.mcap: offset_time is the same for all points: the scans are not deskewed"]


@pytest.mark.parametrize("package", ["livox_ros_driver", "livox_ros_driver2"])
@pytest.mark.parametrize("ros", ["ros1", "cdr"])
def test_a_bag_of_either_driver(tmp_path: Path, package: str, ros: str) -> None:
    store, raw, _ = message(package, ros)
    path = tmp_path / ("a.bag" if ros == "ros1" else "a")
    writer: Any = Writer1(path) if ros == "ros1" else Writer2(path, version=8, storage_plugin=StoragePlugin.MCAP)
    with writer:
        connection = writer.add_connection("/livox/lidar", f"{package}/msg/CustomMsg", typestore=store)
        writer.write(connection, STAMP_NS, raw)
    (scan,) = open_source(path)
    assert (len(scan.points), scan.stamp_ns) == (48, STAMP_NS)
    (topic,) = recording_info(path).topics
    assert topic.first_cloud is not None
    assert topic.first_cloud.frame_id == "livox_frame"
    assert topic.first_cloud.times == pytest.approx((0, 0.0196))


@pytest.mark.parametrize("ros", ["ros1", "cdr"])
def test_an_empty_message_and_a_cut_one(ros: Any) -> None:
    _, raw, _ = message("livox_ros_driver", ros, count=5)
    for length in range(len(raw)):
        with pytest.raises(InputError, match="no Livox message"):
            LivoxDecoder().decode(raw[:length], ros, 0)
