"""What all ROS messages have in common: how they are encoded, their stamp and their header."""

from __future__ import annotations

from typing import Literal, Protocol, TypeAlias

Encoding: TypeAlias = Literal["ros1", "cdr"]
"""Of ROS 1, and of ROS 2."""


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
