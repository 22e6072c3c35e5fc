"""Clouds that point_cloud_transport compressed by Draco."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import DRACO_TYPE, typestore
from wiclosure.pipeline.sources.open import open_source
from wiclosure.types import Scan

DracoPy = pytest.importorskip("DracoPy")
STORE = typestore("cdr")
STAMP_NS = 1_700_000_000_000_000_000


def compressed(data: bytes, names: list[str], how: str = "draco") -> bytes:
    types = STORE.types
    like: Any = encode_scan(Scan(STAMP_NS, np.ones((1, 3))), STORE)
    field = types["sensor_msgs/msg/PointField"]
    message = types[DRACO_TYPE](
        header=like.header, height=1, width=100,
        fields=[field(name=name, offset=4 * k, datatype=7, count=1) for k, name in enumerate(names)],
        is_bigendian=False, point_step=4 * len(names), row_step=400 * len(names),
        compressed_data=np.frombuffer(data, np.uint8), is_dense=True, format=how,
    )  # fmt: skip
    return bytes(STORE.serialize_cdr(message, DRACO_TYPE))


def bag(path: Path, raw: bytes) -> Path:
    with Writer(path, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        writer.write(writer.add_connection("/points/draco", DRACO_TYPE, typestore=STORE), STAMP_NS, raw)
    return path


def test_points_intensity_and_times(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(-20, 20, (100, 3)).astype(np.float32)
    intensity = np.arange(100, dtype=np.float32)[:, None]
    times = np.linspace(0, 0.1, 100, dtype=np.float32)[:, None]
    data = DracoPy.encode(
        points, quantization_bits=24, preserve_order=True, generic_attributes={1: intensity, 2: times}
    )
    raw = compressed(data, ["x", "y", "z", "intensity", "time"])
    (scan,) = open_source(bag(tmp_path / "a", raw))
    assert scan.stamp_ns == STAMP_NS
    np.testing.assert_allclose(scan.points, points, atol=1e-4)
    np.testing.assert_allclose(scan.intensity, intensity[:, 0])
    np.testing.assert_allclose(scan.times, times[:, 0], atol=1e-7)


def test_without_points_it_is_an_empty_scan(tmp_path: Path) -> None:
    (scan,) = open_source(bag(tmp_path / "a", compressed(b"", [])))
    assert len(scan.points) == 0


@pytest.mark.parametrize(("how", "data", "says"), [("zlib", b"x", "only draco"), ("draco", b"rubbish", "be decoded")])
def test_what_cannot_be_decoded_is_named(tmp_path: Path, how: str, data: bytes, says: str) -> None:
    with pytest.raises(InputError, match=says):
        list(open_source(bag(tmp_path / "a", compressed(data, ["x", "y", "z"], how))))
