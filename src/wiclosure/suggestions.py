"""The name that somebody may have meant who typed one that there is not."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_SIMILAR = 0.5  # of difflib's ratio: `oracl` and `disco-prak` find their names, a word of other letters finds none


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name most like this one, whatever the case of its letters; None where none is like it."""
    by_lower_case = {candidate.lower(): candidate for candidate in known}
    near = difflib.get_close_matches(name.lower(), by_lower_case, n=1, cutoff=_SIMILAR)
    return by_lower_case[near[0]] if near else None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """`did you mean ...? ` for the middle of a message, or nothing."""
    near = nearest(name, known)
    return "" if near is None else f"did you mean {near}? "
