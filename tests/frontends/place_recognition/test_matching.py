from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.frontends.config import MatchingSettings, ScanContextSettings
from wiclosure.frontends.front_end import describe_all, describe_shifted
from wiclosure.frontends.place_recognition.matching import match, spread_out
from wiclosure.frontends.place_recognition.scan_context import ColumnSpectra, compare_descriptors, ring_keys
from wiclosure.types import CandidatePairs, Float32Array, FloatArray, IntArray, PredictionKind, Stage

RINGS, SECTORS = 8, 12


def descriptors(count: int, seed: int) -> Float32Array:
    return np.random.default_rng(seed).random((count, RINGS, SECTORS)).astype(np.float32) ** 3


def all_pairs(count_a: int, count_b: int) -> CandidatePairs:
    a, b = np.divmod(np.arange(count_a * count_b), count_b)
    return CandidatePairs.without_prediction("alpha", "beta", a, b)


class TenMetresApart:
    """Predicts every pair 10 m along x, with a known covariance."""

    def __init__(self, kind: PredictionKind = PredictionKind.POSE) -> None:
        self.kind = kind

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        poses = np.tile(np.eye(4), (len(index_a), 1, 1))
        poses[:, 0, 3] = 10.0
        poses[:, 1, 3] = index_a - index_b
        return poses, np.tile(0.25 * np.eye(6), (len(index_a), 1, 1))


def test_the_same_places_seen_turned_are_proposed_with_their_yaw() -> None:
    a = descriptors(9, 0)
    b = np.roll(a[::-1], -3, axis=2)  # beta meets the places in reverse order, its body turned by +3 sectors
    result = match(all_pairs(9, 9), a, b, MatchingSettings(max_distance=0.05))
    assert [(c.query.index, c.match.index) for c in result.closures] == [(i, 8 - i) for i in range(9)]
    for closure in result.closures:
        assert (closure.passed, closure.measured, closure.prediction) == (Stage.MATCHING, None, None)
        assert closure.query.robot == "alpha"
        assert closure.scan_context is not None
        assert closure.scan_context.yaw_rad == pytest.approx(3 * 2 * np.pi / SECTORS)
    assert (result.pairs_in, result.pairs_compared, result.pairs_alike) == (81, 81, 9)


@given(
    seed=st.integers(0, 500),
    counts=st.tuples(st.integers(1, 12), st.integers(1, 12)),
    neighbours=st.integers(1, 6),
    best=st.integers(1, 3),
    share=st.floats(0, 1),
)
@settings(max_examples=40, deadline=None)
def test_proposals_equal_those_of_a_search_keyframe_by_keyframe(
    seed: int, counts: tuple[int, int], neighbours: int, best: int, share: float
) -> None:
    a, b = descriptors(counts[0], seed), descriptors(counts[1], seed + 1)
    pairs = all_pairs(*counts)
    kept = np.flatnonzero(np.random.default_rng(seed).random(len(pairs)) < share)
    pairs = CandidatePairs.without_prediction("alpha", "beta", pairs.index_a[kept], pairs.index_b[kept])
    chosen = MatchingSettings(ring_key_neighbours=neighbours, candidates_per_keyframe=best, max_distance=0.6)
    result = match(pairs, a, b, chosen)

    key_a, key_b = ring_keys(a, "mean-height"), ring_keys(b, "mean-height")
    ij = list(zip(pairs.index_a.tolist(), pairs.index_b.tolist(), strict=True))

    def nearest(rows: list[tuple[int, int]], cost: dict[tuple[int, int], float], n: int) -> set[tuple[int, int]]:
        found: set[tuple[int, int]] = set()
        for side in (0, 1):
            for keyframe in {pair[side] for pair in rows}:
                own = sorted((pair for pair in rows if pair[side] == keyframe), key=lambda pair: cost[pair])
                found.update(own[:n])
        return found

    near = nearest(ij, {(i, j): float(np.linalg.norm(key_a[i] - key_b[j])) for i, j in ij}, neighbours)
    spectra = ColumnSpectra.of(a), ColumnSpectra.of(b)
    full = {(i, j): float(compare_descriptors(*spectra, np.array([i]), np.array([j]))[0][0]) for i, j in near}
    expected = nearest([pair for pair in near if full[pair] <= 0.6], full, best)
    assert [(c.query.index, c.match.index) for c in result.closures] == sorted(expected)
    assert result.pairs_compared == len(near)


def test_a_prediction_stays_with_its_closure_and_loosens_the_threshold() -> None:
    a, b = descriptors(3, 0), descriptors(4, 1)
    bare = all_pairs(3, 4)
    probability = np.linspace(0.1, 0.9, len(bare))
    predicted = CandidatePairs(
        "alpha", "beta", bare.index_a, bare.index_b, probability, np.ones(len(bare)), TenMetresApart()
    )
    chosen = MatchingSettings(max_distance=1e-3, max_distance_with_prediction=1.0, suppression_where_located=0)
    assert match(bare, a, b, chosen).closures == ()
    closures = match(predicted, a, b, chosen).closures
    assert len(closures) >= 3
    for closure in closures:
        i, j = closure.query.index, closure.match.index
        assert closure.prediction is not None
        assert closure.prediction.kind is PredictionKind.POSE
        np.testing.assert_allclose(closure.prediction.T_query_match[:2, 3], [10.0, i - j])
        np.testing.assert_allclose(closure.prediction.covariance, 0.25 * np.eye(6))
        assert closure.overlap_probability == pytest.approx(probability[i * 4 + j])


def test_of_equally_alike_pairs_the_one_predicted_nearer_is_proposed() -> None:
    alike = np.repeat(descriptors(1, 0), 3, axis=0)
    bare = all_pairs(3, 3)
    unknown = np.full(len(bare), np.nan)
    pairs = CandidatePairs("alpha", "beta", bare.index_a, bare.index_b, unknown, unknown, TenMetresApart())
    closures = match(pairs, alike, alike, MatchingSettings()).closures
    assert [(c.query.index, c.match.index) for c in closures] == [(0, 0), (1, 1), (2, 2)]


def test_no_candidates_give_no_closures() -> None:
    none = np.zeros(0, np.int64)
    pairs = CandidatePairs.without_prediction("alpha", "beta", none, none)
    result = match(pairs, descriptors(3, 0), descriptors(4, 1), MatchingSettings())
    assert (result.closures, result.pairs_in, result.pairs_compared) == ((), 0, 0)


def test_descriptors_of_other_settings_are_refused() -> None:
    with pytest.raises(InputError, match="same settings"):
        match(all_pairs(3, 4), descriptors(3, 0), descriptors(4, 0)[:, :4], MatchingSettings())
    with pytest.raises(InputError, match="keyframe 3 of beta, which has 2"):
        match(all_pairs(3, 4), descriptors(3, 0), descriptors(2, 0), MatchingSettings())


def test_every_pair_is_compared_where_no_ring_keys_are_searched() -> None:
    result = match(all_pairs(9, 7), descriptors(9, 0), descriptors(7, 1), MatchingSettings(ring_key_neighbours=None))
    assert result.pairs_compared == 63


@given(seed=st.integers(0, 500), count=st.integers(0, 60), width=st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_of_pairs_near_each_other_the_best_stays(seed: int, count: int, width: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, cost = rng.integers(0, 20, count), rng.integers(0, 20, count), rng.random(count)
    kept = spread_out(a, b, cost, width, None)
    apart = np.maximum(np.abs(a[:, None] - a[kept]), np.abs(b[:, None] - b[kept]))
    # What is left out lies near something cheaper that stayed; what stayed lies apart.
    near_better = ((apart <= width) & (cost[kept] <= cost[:, None])).any(axis=1)
    assert near_better.all()
    assert (apart[kept][~np.eye(len(kept), dtype=bool)] > width).all()


def test_a_budget_spreads_what_is_proposed_over_all_places() -> None:
    # Two places: a long one with the best scores, and a short one.
    a = np.concatenate([np.arange(100), np.arange(300, 310)])
    cost = np.concatenate([np.linspace(0, 0.1, 100), np.linspace(0.2, 0.3, 10)])
    kept = spread_out(a, a, cost, 0, 12)
    assert len(kept) <= 12
    assert (a[kept] >= 300).any()
    np.testing.assert_array_equal(kept, np.sort(kept))
    assert len(spread_out(a, a, cost, 0, None)) == 110


def test_one_place_gives_few_closures_when_told_so() -> None:
    same = descriptors(12, 0)
    result = match(all_pairs(12, 12), same, same, MatchingSettings(suppression=3, max_distance=0.05))
    assert len(result.closures) == 3
    assert (result.pairs_best, result.pairs_suppressed) == (12, 9)


@pytest.mark.parametrize(
    ("count", "kind", "expected"),
    [(160, PredictionKind.POSE, 40), (12, PredictionKind.POSE, 12), (60, PredictionKind.HEADING, 60)],
)
def test_one_place_gives_few_closures_where_the_filter_tells_where_it_is(
    count: int, kind: PredictionKind, expected: int
) -> None:
    """But all of a short meeting, and all where the filter tells the headings only."""
    same, bare = descriptors(count, 0), all_pairs(count, count)
    pairs = replace(bare, predictor=TenMetresApart(kind))
    chosen = MatchingSettings(max_distance_with_prediction=0.05)
    assert len(match(pairs, same, same, chosen).closures) == expected


def test_a_place_seen_from_another_lane_is_recognised_by_shifted_descriptors() -> None:
    rng = np.random.default_rng(0)
    houses = np.column_stack([rng.uniform(-60, 60, (2, 4000)).T, rng.uniform(-1.5, 8, 4000)])
    settings = ScanContextSettings()
    # Beta's places are alpha's from 3 m further left.
    alpha = [(houses - [x, 0.0, 0.0]).astype(np.float32) for x in (0.0, 25.0)]
    beta = [cloud - np.array([0.0, 3.0, 0.0], np.float32) for cloud in alpha]
    a, b = describe_all(alpha, settings).images, describe_all(beta, settings).images
    chosen = MatchingSettings(max_distance=1.0)
    plain = match(all_pairs(2, 2), a, b, chosen)
    moved = match(all_pairs(2, 2), a, b, chosen, describe_shifted(alpha, settings, 3.0))
    distance = [min(c.scan_context.distance for c in result.closures if c.scan_context) for result in (plain, moved)]
    assert distance[1] < 0.01 < distance[0]
    assert {(0, 0), (1, 1)} <= {(c.query.index, c.match.index) for c in moved.closures}
    assert describe_shifted(alpha, settings, None) == ()
