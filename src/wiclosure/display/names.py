"""Names for people."""

from __future__ import annotations

from collections.abc import Sequence


def listed(names: Sequence[str]) -> str:
    """As in a sentence: alpha; alpha and beta; alpha, beta and gamma."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))
