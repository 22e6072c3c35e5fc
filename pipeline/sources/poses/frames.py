"""Static transforms of a bag, and clouds of several sensors on one topic in the axes of one."""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Protocol, cast

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.formats.plausible import FURTHEST_M, LONGEST_QUATERNION
from wiclosure.pipeline.sources.bag import Bag
from wiclosure.pipeline.sources.messages.headers import HeaderMessage, usual_fields
from wiclosure.types import FloatArray, Scan

logger = logging.getLogger(__name__)

TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_STATIC = "/tf_static"


class _Vector(Protocol):
    x: float
    y: float
    z: float


class _Quaternion(_Vector, Protocol):
    w: float


class _Transform(Protocol):
    translation: _Vector
    rotation: _Quaternion


class TransformStamped(Protocol):
    """`geometry_msgs/TransformStamped`, as rosbags makes it."""

    @property
    def header(self) -> HeaderMessage: ...  # noqa: D102  -- named by ROS

    child_frame_id: str
    transform: _Transform


class _TFMessage(Protocol):
    transforms: list[TransformStamped]


def frame_name(frame_id: str) -> str:
    """The frame without the leading slash that ROS 1 allowed."""
    return frame_id.lstrip("/")


def matrix(transform: _Transform) -> FloatArray | None:
    """`T_parent_child (4, 4)`, or None where the numbers are no transform."""
    p, q = transform.translation, transform.rotation
    numbers = np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w], float)
    if not (np.abs(numbers[:3]) < FURTHEST_M).all() or not 1e-9 < np.abs(numbers[3:]).max() < LONGEST_QUATERNION:
        return None
    return se3.from_rotation_translation(Rotation.from_quat(numbers[3:]).as_matrix(), numbers[:3])


class StaticTransforms:
    """The transforms on `/tf_static`, as a graph of frames."""

    def __init__(self, edges: Mapping[tuple[str, str], FloatArray]) -> None:
        self._edges = {**edges, **{(child, parent): se3.inverse(T) for (parent, child), T in edges.items()}}

    def __len__(self) -> int:
        """Number of transforms, each counted once."""
        return len(self._edges) // 2

    @classmethod
    def of(cls, bag: Bag) -> StaticTransforms:
        """Those of a bag; none where it has no such topic."""
        edges: dict[tuple[str, str], FloatArray] = {}
        for name, topic in bag.topics.items():
            if name.endswith(_STATIC) and topic.msgtype in TF_TYPES and topic.is_ros:
                for _, message in bag.messages(name):
                    with usual_fields(f"{bag.path}, topic {name}"):
                        for stamped in cast("_TFMessage", message).transforms:
                            T = matrix(stamped.transform)
                            if T is not None:
                                edges[frame_name(stamped.header.frame_id), frame_name(stamped.child_frame_id)] = T
        return cls(edges)

    def between(self, target: str, source: str) -> FloatArray | None:
        """`T_target_source (4, 4)`, or None where nothing connects the two frames."""
        target, source = frame_name(target), frame_name(source)
        found = {target: np.eye(4)}
        waiting = deque([target])
        while waiting and source not in found:
            here = waiting.popleft()
            for (parent, child), T in self._edges.items():
                if parent == here and child not in found:
                    found[child] = found[here] @ T
                    waiting.append(child)
        return found.get(source)


class OneFrame:
    """Turns the scans of one topic into the axes of one frame.

    Args:
        bag: holds the static transforms.
        place: what is read, for the log.
        first: frames of the first scans; the most frequent is taken, of several the first.
    """

    def __init__(self, bag: Bag, place: str, first: Iterable[str]) -> None:
        self._bag, self._place = bag, place
        named = Counter(filter(None, map(frame_name, first)))
        self._frame = named.most_common(1)[0][0] if named else ""
        self._T_frame: dict[str, FloatArray | None] = {}
        self._left_out: Counter[str] = Counter()

    def turned(self, scan: Scan, frame_id: str) -> Scan | None:
        """The scan in the axes of all, or None where nothing tells how; a frame without a name is that of all."""
        frame = frame_name(frame_id)
        self._frame = self._frame or frame
        if frame in {self._frame, ""}:
            return scan
        if frame not in self._T_frame:
            T = self._T_frame[frame] = StaticTransforms.of(self._bag).between(self._frame, frame)
            if T is not None:
                logger.warning(
                    "%s: clouds of frame %s are turned into the axes of %s by /tf_static",
                    self._place,
                    frame,
                    self._frame,
                )
        T = self._T_frame[frame]
        if T is None:
            self._left_out[frame] += 1
            return None
        return replace(scan, points=scan.points @ T[:3, :3].T + T[:3, 3])

    def report(self) -> None:
        """Says what was left out."""
        for frame, count in self._left_out.items():
            logger.warning(
                "%s: %d clouds of frame %s were left out: no static transform connects it with %s;"
                " record /tf_static, or each sensor on a topic of its own", self._place, count, frame, self._frame,
            )  # fmt: skip
