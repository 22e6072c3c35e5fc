"""Which robot carries the tag of an id."""

from __future__ import annotations

import math
import re
from collections.abc import Collection

import numpy as np

from wiclosure.errors import InputError
from wiclosure.pipeline.radio.source import RadioSource

_WHOLE = re.compile(r"[+-]?\d+(\.0*)?")
_HEXADECIMAL = re.compile(r"0[xX][0-9a-fA-F]+")
_ADDRESS = re.compile(r"[0-9a-fA-F]{2}([:-][0-9a-fA-F]{2}){3,7}")
_TAIL = re.compile(r"(\d+)$")


def canonical(tag: object) -> str:
    """An id as it is compared: `7`, `7.0`, `07` and `0x7` are one tag, `022E` and `022e` as well.

    Bytes, as messages have them for addresses, are `de:ca:00:07`, with colons, dashes or neither.
    """
    text = tag_text(tag)
    if _ADDRESS.fullmatch(text):
        text = re.sub("[:-]", "", text)
    if _HEXADECIMAL.fullmatch(text):
        return str(int(text, 16))
    whole = float(text) if _WHOLE.fullmatch(text) else math.inf
    return str(int(whole)) if math.isfinite(whole) else text.casefold()


def tag_text(tag: object) -> str:
    """An id for people; bytes as an address."""
    if isinstance(tag, bytes) or (isinstance(tag, np.ndarray) and tag.dtype == np.uint8):
        return ":".join(f"{byte:02x}" for byte in tag)
    return str(tag).strip()


def number_at_end(name: str) -> int | None:
    """2 of `turtle02`."""
    found = _TAIL.search(name)
    return None if found is None else int(found[1])


class TagNames:
    """Names robots by the ids of their tags.

    Args:
        source: its `robots` and `anchors`.
        known: the robots that there are; None takes every name as it comes.

    Raises:
        InputError: `robots` names one that is not there, or goes by numbers that several robots share.
    """

    def __init__(self, source: RadioSource, known: Collection[str] | None) -> None:
        self._known = None if known is None else set(known)
        self._anchors = {canonical(tag) for tag in source.anchors}
        self._mapped = source.robots is not None
        if source.robots == "by number":
            self._robots = self._by_number(source, known)
        else:
            self._robots = {canonical(tag): robot for tag, robot in (source.robots or {}).items()}

    def is_anchor(self, tag: object) -> bool:
        """Whether the id is known to be no robot's."""
        return canonical(tag) in self._anchors

    def robot(self, tag: object) -> str | None:
        """The robot of an id, or None."""
        if found := self._robots.get(canonical(tag)):
            return found if self._known is None or found in self._known else None
        name = tag_text(tag)
        if self._known is None:
            return None if self._mapped or not name else name
        return name if name in self._known else None

    @staticmethod
    def _by_number(source: RadioSource, known: Collection[str] | None) -> dict[str, str]:
        if known is None:
            raise InputError(
                f"{source.described()}: robots are found by number, but none are named; map the ids instead"
            )
        numbers = [(number_at_end(robot), robot) for robot in known]
        found = {str(number): robot for number, robot in numbers if number is not None}
        if len(found) < len(numbers):
            raise InputError(
                f"{source.described()}: the robots {', '.join(known)} do not end in numbers of their own;"
                " map the ids instead, as robots: {2: alpha}"
            )
        return found
