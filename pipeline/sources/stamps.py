"""Stamps of a stream of messages, mended by their times of reception where a clock failed.

A header's stamp is the sensor's own word on the time, and better than the time of reception, which jitters.  But single
stamps are wrong, some drivers leave them all alike, and clocks are set while a recording runs.  Three rules, each over
the next few messages:

- a stamp that those after it fall back behind is a stray: the message is left out;
- where stamps stand still or go back and stay there, the clock is not to be trusted: from there on the times of
  reception are used, moved by what both clocks differed before;
- a leap ahead that stays is a gap in the recording, or a clock that was set: it is kept, and said where the times of
  reception do not know of it.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Generic, NamedTuple, TypeVar

logger = logging.getLogger(__name__)

_AHEAD = 3  # messages that are looked at to tell a stray from a leap
_LEAP_NS = 60 * 10**9  # both clocks may drift, and messages wait; so far apart they come by a fault alone

_NEAR_NS = 5 * 10**7  # no stray that lies so near is beyond the next stamp
_SLOW = 30  # times slower than the recording no clock goes; where bags are converted, receptions may come faster

_Content = TypeVar("_Content")


class Stamped(NamedTuple, Generic[_Content]):
    """A message with its header's stamp (0: none) and the time of reception, in nanoseconds."""

    header_ns: int
    received_ns: int
    content: _Content


def mended(messages: Iterable[Stamped[_Content]], place: str) -> Iterator[tuple[int, _Content]]:
    """Stamps that increase, with their messages; strays are left out, and what was done is logged.

    Args:
        messages: in order of reception.
        place: what they are, for the log.
    """
    mender = _Mender(place)
    waiting = iter(messages)
    window = deque(islice(waiting, 1))
    while window:
        if not mender.is_plain(window[0]):  # only then: messages that wait are cold when their turn comes
            window.extend(islice(waiting, _AHEAD + 1 - len(window)))
        yield from mender.first_of(window)
        if not window:
            window.extend(islice(waiting, 1))
    mender.report()


class _Mender:
    def __init__(self, place: str) -> None:
        self._place = place
        self._last_ns: int | None = None
        self._clocks_differ_ns = 0
        self._by_reception = False
        self._strays: list[int] = []
        self._late = self._number = self._missing = self._repeated = 0
        self._header_ns = 0  # of the last message whose stamp was used
        self._begun: tuple[int, int] | None = None
        self._ended = (0, 0)

    def is_plain(self, message: Stamped[_Content]) -> bool:
        """Whether the stamp follows the last one, as the time of reception does: nothing after it need be known."""
        if self._last_ns is None or self._by_reception or message.header_ns <= self._last_ns:
            return False
        return abs(message.header_ns - message.received_ns - self._clocks_differ_ns) <= _NEAR_NS

    def first_of(self, window: deque[Stamped[_Content]]) -> Iterator[tuple[int, _Content]]:
        """The first message with its stamp, or nothing where it is left out."""
        message = window.popleft()
        stamp_ns = self._stamp(message, [later.header_ns for later in window], window)
        self._number += 1
        if stamp_ns is None:
            self._strays.append(self._number - 1)
        elif self._last_ns is not None and stamp_ns <= self._last_ns:
            self._late += 1
        else:
            self._last_ns, self._header_ns = stamp_ns, message.header_ns
            self._ended = (stamp_ns, message.received_ns)
            self._begun = self._begun or self._ended
            yield stamp_ns, message.content

    def report(self) -> None:
        """Says what was left out."""
        if self._strays:
            some = ", ".join(map(str, self._strays[:5])) + (" ..." if len(self._strays) > 5 else "")
            logger.warning(
                "%s: %d messages have stamps far from their neighbours' and were left out (number %s)",
                self._place, len(self._strays), some,
            )  # fmt: skip
        for count, what in ((self._missing, "have no stamps"), (self._repeated, "repeat the stamp before them")):
            if count:
                logger.warning("%s: %d messages %s; times of reception are used for them", self._place, count, what)
        if self._late:
            logger.warning(
                "%s: %d messages have stamps that repeat or go back and were left out", self._place, self._late
            )

        stamps_ns, received_ns = (
            end - begin for begin, end in zip(self._begun or self._ended, self._ended, strict=True)
        )
        if 0 < stamps_ns * _SLOW < received_ns:
            logger.warning(
                "%s: %.3g s pass by the stamps while the recording takes %.3g s: the stamps are in another unit or"
                " wrong; write those of the recording anew", self._place, stamps_ns * 1e-9,
                received_ns * 1e-9,
            )  # fmt: skip

    def _stamp(self, message: Stamped[_Content], later_ns: list[int], window: deque[Stamped[_Content]]) -> int | None:
        """The stamp to use, or None for a stray."""
        header_ns = message.header_ns
        if self._by_reception or header_ns == 0:
            self._missing += not self._by_reception
            return message.received_ns + self._clocks_differ_ns
        known_ns = [stamp for stamp in later_ns if stamp]
        if self._last_ns is None:
            return self._first(message, known_ns, window)
        if header_ns <= self._last_ns:
            if later_ns := [stamp for stamp in known_ns if stamp > self._last_ns]:
                return self._between(message, min(later_ns))
            return self._distrust(message, "stand still" if header_ns == self._last_ns else "go back")
        if self._is_ahead_alone(message, known_ns):
            return None
        leap_ns = header_ns - message.received_ns - self._clocks_differ_ns
        if abs(leap_ns) > _LEAP_NS and self._number:
            logger.warning(
                "%s: stamps leap by %.0f s at message %d, times of reception do not", self._place, leap_ns * 1e-9,
                self._number,
            )  # fmt: skip
        self._clocks_differ_ns = header_ns - message.received_ns
        return header_ns

    def _first(self, message: Stamped[_Content], later_ns: list[int], window: deque[Stamped[_Content]]) -> int | None:
        """The first stamp: nothing comes before it that it could be measured by."""
        header_ns = message.header_ns
        if later_ns and len(set(later_ns)) == 1 and header_ns == later_ns[0]:
            return self._distrust(message, "stand still")
        if len(later_ns) >= 2:
            differ_ns = sorted(stamped.header_ns - stamped.received_ns for stamped in window)
            usual_ns = differ_ns[len(differ_ns) // 2]
            agreeing = sum(abs(each - usual_ns) <= _LEAP_NS for each in differ_ns)
            elsewhere = abs(header_ns - message.received_ns - usual_ns) > _LEAP_NS and agreeing >= 2
            if header_ns > max(later_ns) or elsewhere:
                return None
        self._clocks_differ_ns = header_ns - message.received_ns
        return header_ns

    def _between(self, message: Stamped[_Content], next_ns: int) -> int | None:
        """The time of reception for one that repeats the stamp before, where that lies before the next stamp."""
        stamp_ns = message.received_ns + self._clocks_differ_ns
        if message.header_ns != self._header_ns or not (self._last_ns or 0) < stamp_ns < next_ns:
            return None
        self._repeated += 1
        return stamp_ns

    def _is_ahead_alone(self, message: Stamped[_Content], later_ns: list[int]) -> bool:
        """Whether the stamps after it fall back behind this one, but not behind those before."""
        if later_ns:
            return any(self._last_ns is not None and self._last_ns < stamp < message.header_ns for stamp in later_ns)
        return abs(message.header_ns - message.received_ns - self._clocks_differ_ns) > _LEAP_NS

    def _distrust(self, message: Stamped[_Content], why: str) -> int:
        """From here on, times of reception."""
        self._by_reception = True
        logger.warning(
            "%s: stamps %s from message %d on; times of reception are used from there", self._place, why, self._number
        )
        return message.received_ns + self._clocks_differ_ns
