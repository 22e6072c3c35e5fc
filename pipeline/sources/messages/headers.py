"""What all ROS messages have in common: their stamp and their header."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

from wiclosure.errors import InputError


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
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


@contextmanager
def usual_fields(place: str) -> Iterator[None]:
    """Turns into one line what comes of messages whose fields are not those that their type has.

    Bags bring their own definitions, which may be another version's or damaged.

    Raises:
        InputError: inside, a field is missing or of another kind.
    """
    try:
        yield
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"{place}: the bag's own definition of its messages is another ({error}); is it damaged?"
        ) from error
