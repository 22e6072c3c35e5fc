from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, CandidatePairs, FilterResult, FrameAlignment, RadioLinks

ALIGNED = AlignmentHypothesis(se3.from_yaw(0.5, np.array([1.0, -2.0, 0.25])), -12.34, ((0, 0), (1, -1)))


def alignment(*, ambiguous: bool) -> FrameAlignment:
    return FrameAlignment("alpha", "beta", ALIGNED, np.eye(6), ambiguous, "eight paths agree")


def test_kept_pairs_and_determined_alignments_are_counted():
    pairs = tuple(
        CandidatePairs.without_prediction("alpha", other, np.arange(n), np.arange(n))
        for other, n in (("beta", 3), ("gamma", 4))
    )
    result = FilterResult("wiclosure", pairs, 100, (alignment(ambiguous=True), alignment(ambiguous=False)), seconds=1.5)
    assert result.pairs_kept == 7
    assert repr(result) == "FilterResult('wiclosure', 7 of 100 pairs kept, 1 of 2 alignments certain, 1.50 s)"
    assert FilterResult("none", (), 0).pairs_kept == 0


def test_links_are_as_many_as_their_ranges():
    n, vectors = 4, np.zeros((4, 3))
    index = np.arange(n)
    links = RadioLinks(
        "alpha", "beta", np.eye(4), np.eye(6), index, index, vectors, vectors, np.ones(n, bool), np.full(n, np.nan),
        np.ones(n), vectors, np.zeros((n, 3, 3)),
    )  # fmt: skip
    assert len(links) == 4
    assert repr(links) == "RadioLinks('alpha' and 'beta', 4 links)"
