"""What all ROS messages have in common: their stamp and their header."""

from __future__ import annotations

from typing import Protocol, runtime_checkable


@runtime_checkable
class TimeMessage(Protocol):
    """`builtin_interfaces/Time`, as rosbags makes it."""

    @property
    def sec(self) -> int: ...  # noqa: D102  -- named by ROS
    @property
    def nanosec(self) -> int: ...  # noqa: D102


class HeaderMessage(Protocol):
    """`std_msgs/Header`, as rosbags makes it."""

    @property
    def stamp(self) -> TimeMessage: ...  # noqa: D102
    @property
    def frame_id(self) -> str: ...  # noqa: D102


def nanoseconds_of(stamp: TimeMessage) -> int:
    """A ROS time in nanoseconds; 0 where the driver left it out."""
    return stamp.sec * 10**9 + stamp.nanosec
