"""Look-alike pairs of two robots, proposed without what the radio predicts of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wiclosure.frontends.config import MatchingSettings
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.place_recognition.matching import match
from wiclosure.types import CandidatePairs, Closure

_MOST_PAIRS = 1_000_000  # that are compared: of longer paths every so many keyframes


def unpredicted(
    pair: tuple[str, str],
    also: Sequence[Closure],
    fronts: Mapping[str, FrontEndResult],
    settings: MatchingSettings,
    budget: int,
) -> list[Closure]:
    """Proposals of the most look-alike pairs, spread over the paths.

    Args:
        pair: the robots.
        also: closures that are proposed besides, without their predictions; of them too at most `budget`.
        fronts: descriptors by robot.
        settings: of the matching.
        budget: how many.
    """
    if budget == 0:
        return []
    a, b = (fronts[robot].descriptors for robot in pair)
    alike = match(every_pair(pair, len(a), len(b)), a, b, settings.model_copy(update={"budget": budget})).closures
    known = {(c.query, c.match) for c in alike}
    evenly = np.linspace(0, len(also) - 1, min(len(also), budget)).round().astype(int)
    chosen = [also[n] for n in np.unique(evenly)]
    again = [Closure(c.query, c.match, scan_context=c.scan_context) for c in chosen if (c.query, c.match) not in known]
    return [*alike, *again]


def every_pair(pair: tuple[str, str], size_a: int, size_b: int) -> CandidatePairs:
    """All pairs of so many keyframes of two robots; of long paths those of every so many keyframes."""
    step = int(np.ceil(np.sqrt(max(size_a * size_b / _MOST_PAIRS, 1.0))))
    index_a, index_b = np.meshgrid(np.arange(0, size_a, step), np.arange(0, size_b, step), indexing="ij")
    return CandidatePairs.without_prediction(*pair, index_a.reshape(-1), index_b.reshape(-1))
