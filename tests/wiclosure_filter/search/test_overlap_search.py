"""The search returns exactly what a look at every pair returns."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.wiclosure_filter.config import GateSettings
from wiclosure.wiclosure_filter.search.gates import make_gate
from wiclosure.wiclosure_filter.search.overlap_search import SearchTrace, find_overlap
from wiclosure.wiclosure_filter.search.pair_model import KeyframePlaces, PairModel, ShortestRoutes

from .random_places import random_places


def random_model(seed: int, d: int, shortest: bool) -> PairModel:
    rng = np.random.default_rng(seed)
    extent = rng.choice([10.0, 100.0, 400.0])
    nodes_a, nodes_b = rng.integers(1, 9, 2)
    a = random_places(rng, rng.integers(1, 90), nodes_a, d, extent)
    b = random_places(rng, rng.integers(1, 90), nodes_b, d, extent)
    root = rng.normal(size=(nodes_a, nodes_b, d, d)) * 10 ** rng.uniform(-2, 2, (nodes_a, nodes_b, 1, 1))
    table = root @ np.swapaxes(root, 2, 3) + 1e-4 * np.eye(d)
    routes = None
    if shortest:
        routes = ShortestRoutes(rng.uniform(0, 9, (3, len(a))), rng.uniform(0, 9, (3, len(b))), int(rng.integers(3)))
    return PairModel(a, b, table, routes)


def brute_force(model: PairModel, gate_settings: GateSettings) -> np.ndarray:
    p, k = (grid.ravel() for grid in np.indices((len(model.a), len(model.b))))
    keep = model.applies(p, k)
    keep &= make_gate(gate_settings).score(model.displacement(p, k), model.covariance(p, k)).keep
    return np.stack([p[keep], k[keep]], axis=1)


gates = st.builds(
    GateSettings,
    method=st.sampled_from(["overlap_probability", "mahalanobis"]),
    sensor_range_m=st.sampled_from([1.0, 10.0, 35.0, 200.0]),
    min_probability=st.sampled_from([1e-4, 0.01, 0.05, 0.3, 0.5, 0.9, 0.999]),
    mahalanobis_threshold=st.sampled_from([0.1, 1.0, 3.0, 10.0]),
)


cases = given(
    seed=st.integers(0, 2**32 - 1), d=st.sampled_from([2, 2, 2, 3]), shortest=st.booleans(), gate_settings=gates
)


@settings(max_examples=200, deadline=None, derandomize=True)
@cases
def test_no_pair_is_lost_and_none_added(seed: int, d: int, shortest: bool, gate_settings: GateSettings) -> None:
    assert_finds_what_brute_force_finds(seed, d, shortest, gate_settings)


@pytest.mark.slow
@settings(max_examples=2000, deadline=None)
@cases
def test_no_pair_is_lost_in_thousands_of_cases(seed: int, d: int, shortest: bool, gate_settings: GateSettings) -> None:
    assert_finds_what_brute_force_finds(seed, d, shortest, gate_settings)


def assert_finds_what_brute_force_finds(seed: int, d: int, shortest: bool, gate_settings: GateSettings) -> None:
    model = random_model(seed, d, shortest)
    found = find_overlap(model, make_gate(gate_settings))
    np.testing.assert_array_equal(np.stack([found.index_a, found.index_b], axis=1), brute_force(model, gate_settings))


def crossing_roads(size: int) -> PairModel:
    """Two roads of `size` keyframes that share one per cent and part for good."""
    shared = size // 100
    along = np.arange(size) - 0.5 * size
    apart = np.clip(np.abs(along) - 0.5 * shared, 0, None)
    places = [
        KeyframePlaces(
            np.stack([along, side * apart], axis=1),
            np.zeros((size, 2, 2)),
            np.minimum(np.arange(size) * 10 // size, 8),
            np.full(size, 0.5),
        )
        for side in (-1.0, 1.0)
    ]
    return PairModel(places[0], places[1], np.broadcast_to(4.0 * np.eye(2), (10, 10, 2, 2)))


def test_work_follows_the_output_not_the_product() -> None:
    """Eight times the keyframes on each side: 64 times the pairs, but nowhere near 64 times the work."""
    visited = []
    for size in (5_000, 40_000):
        trace = SearchTrace()
        found = find_overlap(crossing_roads(size), make_gate(GateSettings()), trace)
        segments = sum(len(part[2]) for step in trace.steps.values() for part in step)
        visited.append((len(found.index_a), segments))
    (pairs_small, segments_small), (pairs_large, segments_large) = visited
    assert segments_large / segments_small <= 1.5 * pairs_large / pairs_small
    assert pairs_large / pairs_small < 10


def test_ten_billion_pairs_need_no_list_of_all() -> None:
    found = find_overlap(crossing_roads(100_000), make_gate(GateSettings()))
    assert len(found.index_a) > 30_000


def test_trace_keeps_the_boxes_of_every_step() -> None:
    trace = SearchTrace()
    model = crossing_roads(1000)
    find_overlap(model, make_gate(GateSettings()), trace)
    assert sorted(trace.steps) == list(range(8))
    height_a, height_b, segment_a, segment_b = trace.steps[7][0]
    assert (height_a, height_b, segment_a.tolist(), segment_b.tolist()) == (7, 7, [0], [0])


@pytest.mark.parametrize("sizes", [(1, 1), (1, 90), (90, 1), (8, 9), (16, 17)])
def test_any_sizes(sizes: tuple[int, int]) -> None:
    rng = np.random.default_rng(1)
    a, b = (random_places(rng, size, 3, 2, 10.0) for size in sizes)
    model = PairModel(a, b, np.broadcast_to(np.eye(2), (3, 3, 2, 2)))
    found = find_overlap(model, make_gate(GateSettings()))
    np.testing.assert_array_equal(np.stack([found.index_a, found.index_b], axis=1), brute_force(model, GateSettings()))
