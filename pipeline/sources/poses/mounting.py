"""Where a LiDAR is mounted, by the static transforms of its bag."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.poses.frames import StaticTransforms, frame_name
from wiclosure.pipeline.sources.scan_messages import ScanMessages
from wiclosure.pipeline.sources.scan_topics import choose_topic
from wiclosure.types import FloatArray


class LidarMount(NamedTuple):
    """The frame of a LiDAR's clouds, and `T_body_lidar (4, 4)`, or None where nothing tells."""

    frame: str
    T_body_lidar: FloatArray | None


def lidar_mount(
    path: Path, topic: str | None, body_frame: str, beside: Path | None = None, *, salvage: bool = False
) -> LidarMount:
    """Where the LiDAR of a topic of clouds is in a body's frame.

    Args:
        path: bag with the clouds.
        topic: of the clouds; None takes the only one.
        body_frame: the frame that the answer is given in.
        beside: another bag that may hold the static transforms.
        salvage: use what can be read of a damaged bag.

    Raises:
        InputError: a bag or the topic cannot be read.
    """
    with open_bag(path, salvage=salvage) as bag:
        clouds = bag.topics[choose_topic(path, bag.topics, topic)]
        _, raw = next(bag.read(clouds.name), (0, b""))
        try:
            frame = frame_name(ScanMessages(clouds)(raw, 0).frame_id)
        except Exception:  # a damaged message; reading the scans will name it
            return LidarMount("", None)
        found = StaticTransforms.of(bag).between(body_frame, frame)
    if found is None and beside is not None and bag_kind(beside):
        with open_bag(beside, salvage=salvage) as bag:
            found = StaticTransforms.of(bag).between(body_frame, frame)
    return LidarMount(frame, found)
