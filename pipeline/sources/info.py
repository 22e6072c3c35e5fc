"""What is in a recording, without reading its scans."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bag import Bag, BagTopic
from wiclosure.pipeline.sources.bag_files import KINDS
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.folder import FolderSource
from wiclosure.pipeline.sources.kitti import KittiSource
from wiclosure.pipeline.sources.messages.livox import LIVOX_POINT, LIVOX_TYPES
from wiclosure.pipeline.sources.messages.pointcloud2 import FORMATS, PointCloud2Message
from wiclosure.pipeline.sources.open import guess_loader
from wiclosure.pipeline.sources.scan_messages import ScanDecoder, ScanMessages
from wiclosure.pipeline.sources.scan_topics import holds_scans


@dataclass(frozen=True, slots=True)
class FieldInfo:
    """A field of a PointCloud2: its NumPy type (`f4`, `u2`) and place in the point."""

    name: str
    dtype: str
    offset: int


@dataclass(frozen=True, slots=True)
class CloudInfo:
    """The first cloud of a topic.

    Args:
        height, width: announced size; height 1 for clouds without rows.
        returns: points that are finite and not at the origin.
        point_step: bytes a point.
        frame_id: the sensor's frame.
        fields: as recorded.
        times: from when to when its points were measured, seconds after the stamp; None without per-point times.
    """

    height: int
    width: int
    returns: int
    point_step: int
    frame_id: str
    fields: tuple[FieldInfo, ...]
    times: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """A topic of a bag; `first_cloud` is known for those of point clouds."""

    name: str
    msgtype: str
    count: int
    first_cloud: CloudInfo | None = None


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """What a recording holds.

    Args:
        path: file or folder.
        kind: `ROS 1 bag`, `KITTI folder`, ...
        start_ns: time of the first message or scan; None where there is none.
        duration_s: from the first to the last.
        count: messages or scans.
        bytes_on_disk: size of all files.
        topics: of a bag, by name; none for folders of scans.
        notes: sentences on anything unusual.
    """

    path: Path
    kind: str
    start_ns: int | None
    duration_s: float
    count: int
    bytes_on_disk: int
    topics: tuple[TopicInfo, ...] = ()
    notes: tuple[str, ...] = ()


def recording_info(path: Path | str, *, salvage: bool = False) -> RecordingInfo:
    """Looks into a bag or folder of scans.

    Raises:
        InputError: see `wiclosure.pipeline.sources.open.open_source`.
    """
    path = Path(path)
    if guess_loader(path) == "rosbag":
        with open_bag(path, salvage=salvage) as bag:
            return _bag_info(bag, salvage=salvage)
    source = KittiSource(path) if guess_loader(path) == "kitti" else FolderSource(path)
    kind = "KITTI folder" if isinstance(source, KittiSource) else f"folder of {source.scan_files[0].suffix} files"
    stamps_ns, size = source.stamps_ns, sum(file.stat().st_size for file in source.scan_files)
    duration_s = int(stamps_ns[-1] - stamps_ns[0]) * 1e-9
    beside = [name for name in ("poses.txt", "calib.txt") if (path / name).is_file()]
    notes: tuple[str, ...] = (f"With {' and '.join(beside)}.",) if beside else ()
    if isinstance(source, FolderSource):
        made_up = " (made up: nothing tells when the clouds were taken)" if source.made_up else ""
        notes += (f"Stamps: {source.stamps_from}{made_up}.",)
    return RecordingInfo(path, kind, int(stamps_ns[0]), duration_s, len(source), size, (), notes)


def _bag_info(bag: Bag, *, salvage: bool) -> RecordingInfo:
    topics = tuple(
        TopicInfo(topic.name, _type(topic), topic.count, _first_cloud(bag, topic.name)) for topic in bag.topics.values()
    )
    count = sum(topic.count for topic in topics)
    notes = ("Salvaged: only messages that are whole are counted.",) if salvage else ()
    start_ns = bag.start_ns if count else None
    duration_s = (bag.end_ns - bag.start_ns) * 1e-9 if count else 0.0
    return RecordingInfo(bag.path, KINDS[bag.kind], start_ns, duration_s, count, _size(bag.path), topics, notes)


def _type(topic: BagTopic) -> str:
    return topic.msgtype if topic.is_ros else f"{topic.msgtype} ({topic.found.encoding})"


def _first_cloud(bag: Bag, name: str) -> CloudInfo | None:
    topic = bag.topics[name]
    if not holds_scans(topic):
        return None
    received_ns, raw = next(bag.read(name), (0, b""))
    if not raw:
        return None
    try:
        message = ScanMessages(topic)(raw, 0)
        scan = ScanDecoder(topic, f"{bag.path}, topic {name}").decode(message, message.stamp_ns or received_ns)
    except InputError as error:
        raise InputError(f"{bag.path}, topic {name}, message 0: {error}") from error
    except Exception as error:  # rosbags raises anything for bytes that are no such message
        raise InputError(f"{bag.path}, topic {name}, message 0: no {topic.msgtype} ({error})") from error
    times = None if scan.times is None else (float(scan.times.min()), float(scan.times.max()))
    count = len(scan.points)
    if topic.msgtype in LIVOX_TYPES:
        livox = tuple(FieldInfo(name, of[0].str[1:], of[1]) for name, of in (LIVOX_POINT.fields or {}).items())
        return CloudInfo(1, count, count, LIVOX_POINT.itemsize, message.frame_id, livox, times)
    cloud = cast("PointCloud2Message", message.content)  # what compressed ones say of the fields is said alike
    fields = tuple(FieldInfo(f.name, FORMATS.get(f.datatype, "unknown"), f.offset) for f in cloud.fields)
    return CloudInfo(cloud.height, cloud.width, count, cloud.point_step, message.frame_id, fields, times)


def _size(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())
