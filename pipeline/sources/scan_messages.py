"""Messages that hold scans, of all types that can be read: first the header, then the points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from wiclosure.pipeline.sources.bag import BagTopic
from wiclosure.pipeline.sources.messages.draco import CompressedCloud, DracoDecoder
from wiclosure.pipeline.sources.messages.headers import nanoseconds_of
from wiclosure.pipeline.sources.messages.livox import LIVOX_TYPES, LivoxDecoder, livox_header
from wiclosure.pipeline.sources.messages.pointcloud2 import PointCloud2Decoder, PointCloud2Message
from wiclosure.pipeline.sources.messages.ros_types import DRACO_TYPE, deserialize, recorded_typestore
from wiclosure.types import Scan


@dataclass(frozen=True, slots=True, eq=False)
class ScanMessage:
    """A message whose points are still to be decoded.

    Args:
        number: in its topic, from 0.
        stamp_ns: of its header; 0: none.
        frame_id: the sensor's frame, by its header.
        content: what rosbags made of it, or the bytes of a Livox message.
        raw: the whole message as it was recorded.
    """

    number: int
    stamp_ns: int
    frame_id: str
    content: object
    raw: bytes


class ScanMessages:
    """Reads the headers of a topic's messages."""

    def __init__(self, topic: BagTopic) -> None:
        self._encoding, self._msgtype = topic.encoding, topic.msgtype
        self._store = recorded_typestore(topic.encoding, topic.msgtype, topic.found.definition)

    def __call__(self, raw: bytes, number: int) -> ScanMessage:
        """The message in `raw`; anything is raised for bytes that are none."""
        if self._msgtype in LIVOX_TYPES:
            stamp_ns, frame_id = livox_header(raw, self._encoding)
            return ScanMessage(number, stamp_ns, frame_id, raw, raw)
        message = deserialize(self._store, self._encoding, raw, self._msgtype)
        header = cast("PointCloud2Message", message).header
        return ScanMessage(number, nanoseconds_of(header.stamp), header.frame_id, message, raw)


class ScanDecoder:
    """Decodes the points of a topic's messages.

    Args:
        topic: where they come from.
        place: the same in words, for the log.
        period_s: seconds from scan to scan, where they are known.
    """

    def __init__(self, topic: BagTopic, place: str, period_s: float | None = None) -> None:
        self._msgtype, self._encoding = topic.msgtype, topic.encoding
        self._clouds = PointCloud2Decoder(place, period_s)
        self._livox = LivoxDecoder(place)
        self._draco = DracoDecoder(place, period_s)

    def decode(self, message: ScanMessage, stamp_ns: int) -> Scan:
        """The returns of a message, with the stamp that is to be used.

        Raises:
            InputError: the message does not fit its type, or needs what is not installed.
        """
        if self._msgtype in LIVOX_TYPES:
            return self._livox.decode(cast("bytes", message.content), self._encoding, stamp_ns)
        if self._msgtype == DRACO_TYPE:
            return self._draco.decode(cast("CompressedCloud", message.content), stamp_ns)
        return self._clouds.decode(cast("PointCloud2Message", message.content), stamp_ns)
