"""Our own ROS messages, `wiclosure_msgs`: the wireless types of `wiclosure.types`, field by field.

A number that may be absent is NaN; a transmitter's stamp, which may be absent too, has a flag.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.headers import HeaderMessage, TimeMessage, nanoseconds_of
from wiclosure.pipeline.sources.messages.ros_types import HEADING_TYPE, MEASUREMENT_TYPE, PATH_TYPE
from wiclosure.types import AoaFrame, AoaPath, FloatArray, Heading, WirelessMeasurement

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg, Typestore


class PathMessage(Protocol):
    """`wiclosure_msgs/AoaPath`, as rosbags makes it."""

    azimuth: float
    elevation: float
    sigma: float
    weight: float


class MeasurementMessage(Protocol):
    """`wiclosure_msgs/WirelessMeasurement`, as rosbags makes it."""

    @property
    def header(self) -> HeaderMessage: ...  # noqa: D102  -- named by ROS
    @property
    def transmitter_stamp(self) -> TimeMessage: ...  # noqa: D102
    @property
    def paths(self) -> Sequence[PathMessage]: ...  # noqa: D102

    receiver: str
    transmitter: str
    range: float
    range_sigma: float
    aoa_frame: str
    has_transmitter_stamp: bool
    lever_arm_receiver: Sequence[float]
    lever_arm_transmitter: Sequence[float]


class HeadingMessage(Protocol):
    """`wiclosure_msgs/Heading`, as rosbags makes it."""

    @property
    def header(self) -> HeaderMessage: ...  # noqa: D102  -- named by ROS

    robot: str
    heading: float
    sigma: float


def encode_measurement(measurement: WirelessMeasurement, store: Typestore) -> Msg:
    """The message of a measurement."""
    types = store.types
    sent_ns = measurement.transmitter_stamp_ns
    paths = [
        types[PATH_TYPE](azimuth=p.azimuth, elevation=_or_nan(p.elevation), sigma=p.sigma, weight=p.weight)
        for p in measurement.paths
    ]
    return types[MEASUREMENT_TYPE](
        header=encode_header(measurement.stamp_ns, store, measurement.receiver),
        receiver=measurement.receiver,
        transmitter=measurement.transmitter,
        range=_or_nan(measurement.range_m),
        range_sigma=_or_nan(measurement.range_sigma_m),
        paths=paths,
        aoa_frame=measurement.aoa_frame,
        has_transmitter_stamp=sent_ns is not None,
        transmitter_stamp=encode_time(sent_ns or 0, store),
        lever_arm_receiver=_array(measurement.lever_arm_receiver),
        lever_arm_transmitter=_array(measurement.lever_arm_transmitter),
    )


def decode_measurement(message: object) -> WirelessMeasurement:
    """The measurement in a message.

    Raises:
        InputError: a value is impossible (see `WirelessMeasurement`).
    """
    m = cast("MeasurementMessage", message)
    if m.aoa_frame not in {"", "body", "odometry", "world"}:
        raise InputError(f"aoa_frame is {m.aoa_frame!r}; expected body, odometry or world")
    return WirelessMeasurement(
        stamp_ns=nanoseconds_of(m.header.stamp),
        receiver=m.receiver,
        transmitter=m.transmitter,
        range_m=_or_none(m.range),
        range_sigma_m=_or_none(m.range_sigma),
        paths=tuple(AoaPath(p.azimuth, p.sigma, p.weight, _or_none(p.elevation)) for p in m.paths),
        aoa_frame=cast("AoaFrame", m.aoa_frame or "body"),
        transmitter_stamp_ns=nanoseconds_of(m.transmitter_stamp) if m.has_transmitter_stamp else None,
        lever_arm_receiver=_triple(m.lever_arm_receiver),
        lever_arm_transmitter=_triple(m.lever_arm_transmitter),
    )


def encode_heading(heading: Heading, store: Typestore) -> Msg:
    """The message of a heading."""
    return store.types[HEADING_TYPE](
        header=encode_header(heading.stamp_ns, store, heading.robot),
        robot=heading.robot,
        heading=heading.heading,
        sigma=heading.sigma,
    )


def decode_heading(message: object) -> Heading:
    """The heading in a message.

    Raises:
        InputError: a value is impossible (see `Heading`).
    """
    m = cast("HeadingMessage", message)
    return Heading(nanoseconds_of(m.header.stamp), m.robot, m.heading, m.sigma)


def encode_time(stamp_ns: int, store: Typestore) -> Msg:
    """`builtin_interfaces/Time`."""
    return store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)


def encode_header(stamp_ns: int, store: Typestore, frame_id: str) -> Msg:
    """`std_msgs/Header`; that of ROS 1 counts messages as well, which nobody reads."""
    header, stamp = store.types["std_msgs/msg/Header"], encode_time(stamp_ns, store)
    if any(name == "seq" for name, _ in store.fielddefs["std_msgs/msg/Header"][1]):
        return header(seq=0, stamp=stamp, frame_id=frame_id)
    return header(stamp=stamp, frame_id=frame_id)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value


def _array(values: tuple[float, float, float]) -> FloatArray:
    return np.array(values, np.float64)


def _triple(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z
