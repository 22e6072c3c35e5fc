"""An estimate of stretches answers for their keyframes by the numbers that these have in the whole trajectories."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wiclosure.types import FrameAlignment
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.likelihood.frame_prior import FramePrior
from wiclosure.wiclosure_filter.links.links import Links
from wiclosure.wiclosure_filter.search.gates import make_gate
from wiclosure.wiclosure_filter.search.overlap_search import find_overlap
from wiclosure.wiclosure_filter.shared.alternative_estimates import AlternativeEstimates
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedEstimate, share_trajectories
from wiclosure.wiclosure_filter.unjoined.part_estimate import PartEstimate

SETTINGS = FilterSettings()
PAIR = ("a", "b")


def estimated(links: Links, alignment: FrameAlignment, trajectories: object) -> SharedEstimate:
    prior = FramePrior.of(SETTINGS.alignment, SETTINGS.shared_trajectory.gravity_sigma_rad)
    shared = share_trajectories(trajectories, {PAIR: links}, [alignment], prior, SETTINGS.shared_trajectory)
    return shared.estimates[PAIR]


def test_keyframes_keep_their_numbers(make_case: Callable[..., object]) -> None:
    case = make_case("reciprocal", heard=40)
    alignment = align(case.links, case.trajectories, case.settings)
    assert not alignment.ambiguous
    since = int(case.links.index_b.min())
    b = case.trajectories["b"]
    stretch = {"a": range(len(case.trajectories["a"])), "b": range(since, len(b))}
    parts = {"a": case.trajectories["a"], "b": b.subset(np.arange(since, len(b)))}
    part = PartEstimate(estimated(case.links.in_stretch(0, since), alignment, parts), stretch)
    whole = estimated(case.links, alignment, case.trajectories)
    index = np.arange(since + 3, len(b))
    for predicted, expected in zip(
        part.relative_poses("a", index, "b", index), whole.relative_poses("a", index, "b", index), strict=True
    ):
        np.testing.assert_allclose(predicted, expected, atol=0.1)
    gate = make_gate(SETTINGS.gate)
    (model,) = part.models(*PAIR, gate)
    kept = find_overlap(model, gate)
    assert kept.index_b.min() >= since
    # Of keyframes outside, nothing is known.
    outside = np.zeros(1, np.int64)
    if since > 0:
        _, covariance = part.relative_poses("a", outside, "b", outside)
        assert covariance[0, 3, 3] > 1e4
    either = AlternativeEstimates((part, part), gate)
    probability = either.overlap_probability(part, "a", kept.index_a, "b", kept.index_b)
    np.testing.assert_allclose(probability, kept.overlap_probability)
