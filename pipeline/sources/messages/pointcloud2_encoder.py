"""Scans as `sensor_msgs/PointCloud2` messages, for the writers of recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE
from wiclosure.pipeline.sources.messages.wireless_messages import encode_header
from wiclosure.types import Scan

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg, Typestore

_FLOAT32 = 7  # sensor_msgs/PointField.FLOAT32


def encode_scan(scan: Scan, typestore: Typestore, frame_id: str = "lidar") -> Msg:
    """The message of one scan: float32 `x y z`, and `intensity` and `time` (s after the stamp) where the scan has them.

    Args:
        scan: the scan.
        typestore: rosbags' message types of the ROS version to write.
        frame_id: name of the sensor's frame.
    """
    names = ["x", "y", "z"] + ["intensity"] * (scan.intensity is not None) + ["time"] * (scan.times is not None)
    records = np.empty((len(scan.points), len(names)), "<f4")
    records[:, :3] = scan.points
    for name, values in (("intensity", scan.intensity), ("time", scan.times)):
        if values is not None:
            records[:, names.index(name)] = values
    types = typestore.types
    fields = [
        types["sensor_msgs/msg/PointField"](name=name, offset=4 * column, datatype=_FLOAT32, count=1)
        for column, name in enumerate(names)
    ]
    step = records.itemsize * len(names)
    return types[POINT_CLOUD_TYPE](
        header=encode_header(scan.stamp_ns, typestore, frame_id),
        height=1,
        width=len(records),
        fields=fields,
        is_bigendian=False,
        point_step=step,
        row_step=step * len(records),
        data=records.view(np.uint8).reshape(-1),
        is_dense=True,
    )
