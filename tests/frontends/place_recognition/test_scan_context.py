from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.frontends.config import ScanContextSettings
from wiclosure.frontends.place_recognition.scan_context import ColumnSpectra, compare_descriptors, describe, ring_keys
from wiclosure.types import FloatArray

SETTINGS = ScanContextSettings()
SECTOR = 2 * np.pi / SETTINGS.sectors


def town(seed: int, houses: int = 60) -> FloatArray:
    """Vertical columns of points around the sensor, centred within their bins."""
    rng = np.random.default_rng(seed)
    azimuth = (rng.integers(0, SETTINGS.sectors, houses) + rng.uniform(0.3, 0.7, houses)) * SECTOR
    distance = (rng.integers(1, SETTINGS.rings, houses) + 0.5) * SETTINGS.max_range_m / SETTINGS.rings
    feet = np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth), np.full(houses, -1.5)], axis=1)
    heights = rng.uniform(0.5, 10, houses)[:, None, None] * np.linspace(0, 1, 5)[None, :, None]
    return (feet[:, None, :] + heights * [0.0, 0.0, 1.0]).reshape(-1, 3)


def brute_force_profile(query: FloatArray, match: FloatArray) -> FloatArray:
    """The paper's distance at each shift, column by column."""
    sectors = query.shape[1]
    profile = np.zeros(sectors)
    for shift in range(sectors):
        cosines = []
        for j in range(sectors):
            q, m = query[:, (j + shift) % sectors], match[:, j]
            if q.any() and m.any():
                cosines.append(q @ m / np.linalg.norm(q) / np.linalg.norm(m))
        profile[shift] = 1 - sum(cosines) / max(len(cosines), sectors / 4)
    return profile


@given(seed=st.integers(0, 1000), shift=st.integers(-29, 30))
@settings(max_examples=40, deadline=None)
def test_a_turned_cloud_is_recognised_and_its_yaw_found(seed: int, shift: int) -> None:
    points_match = town(seed)
    T_query_match = se3.from_yaw(shift * SECTOR, np.zeros(3))
    points_query = se3.transform(T_query_match, points_match)
    query, match = (ColumnSpectra.of(describe(p, SETTINGS)[None]) for p in (points_query, points_match))
    distance, yaw = compare_descriptors(query, match, np.array([0]), np.array([0]))
    assert distance[0] == pytest.approx(0, abs=1e-4)
    assert np.angle(np.exp(1j * (yaw[0] - shift * SECTOR))) == pytest.approx(0, abs=1e-6)


@given(seed=st.integers(0, 1000), angle=st.floats(-np.pi, np.pi))
@settings(max_examples=40, deadline=None)
def test_ring_keys_do_not_change_when_the_sensor_turns(seed: int, angle: float) -> None:
    shift = np.round(angle / SECTOR) * SECTOR
    clouds = [town(seed), se3.transform(se3.from_yaw(shift, np.zeros(3)), town(seed))]
    descriptors = np.stack([describe(c, SETTINGS) for c in clouds])
    for kind in ("mean-height", "occupied-share"):
        keys = ring_keys(descriptors, kind)
        np.testing.assert_allclose(keys[0], keys[1], atol=1e-5)


@given(
    seed=st.integers(0, 1000),
    counts=st.tuples(st.integers(1, 40), st.integers(1, 40)),
    shape=st.sampled_from([(20, 60), (5, 7), (3, 4)]),
    empty=st.sampled_from([0.0, 0.3, 0.9]),
    share=st.floats(0, 1),
)
@settings(max_examples=30, deadline=None)
def test_all_pairs_at_all_shifts_at_once_equal_shifting_columns_by_hand(
    seed: int, counts: tuple[int, int], shape: tuple[int, int], empty: float, share: float
) -> None:
    rng = np.random.default_rng(seed)
    query, match = (
        (rng.random((count, *shape)) ** 3 * (rng.random((count, 1, shape[1])) >= empty)).astype(np.float32)
        for count in counts
    )
    a, b = np.divmod(np.flatnonzero(rng.random(counts[0] * counts[1]) < share), counts[1])
    order = rng.permutation(len(a))
    a, b = a[order], b[order]
    distance, yaw = compare_descriptors(ColumnSpectra.of(query), ColumnSpectra.of(match), a, b)
    for k in rng.permutation(len(a))[:20]:
        profile = brute_force_profile(query[a[k]], match[b[k]])
        assert distance[k] == pytest.approx(profile.min(), abs=1e-5)
        assert profile[round(yaw[k] / (2 * np.pi) * shape[1])] == pytest.approx(profile.min(), abs=1e-5)


def test_the_number_of_threads_does_not_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    spectra = ColumnSpectra.of(rng.random((100, 20, 60), np.float32) * (rng.random((100, 1, 60)) >= 0.1))
    a, b = np.divmod(rng.permutation(100 * 100), 100)
    results = []
    for processors in (1, 3):
        monkeypatch.setattr("os.cpu_count", lambda processors=processors: processors)
        results.append(compare_descriptors(spectra, spectra, a, b))
    np.testing.assert_array_equal(results[0], results[1])


def test_a_bin_holds_its_greatest_height_above_the_offset() -> None:
    points = np.array([[10.0, 0.1, -1.0], [10.0, 0.1, 3.0], [10.0, 0.1, -5.0], [200.0, 0.0, 1.0]])
    image = describe(points, SETTINGS)
    assert image[2, 0] == pytest.approx(3.0 + SETTINGS.height_offset_m)
    assert np.count_nonzero(image) == 1


def test_bins_of_few_points_are_empty_as_disco_slam_has_it() -> None:
    points = np.repeat([[10.0, 0.1, 0.0], [30.0, 0.1, 0.0]], [5, 4], axis=0)
    image = describe(points, SETTINGS.model_copy(update={"min_points_per_bin": 5}))
    assert np.flatnonzero(image.any(axis=1)).tolist() == [2]


def test_two_alike_columns_are_no_place() -> None:
    points = np.array([[10.0, 0.5, 1.0], [0.5, 10.0, 1.0]])
    spectra = ColumnSpectra.of(describe(points, SETTINGS)[None])
    distance, _ = compare_descriptors(spectra, spectra, np.array([0]), np.array([0]))
    assert distance[0] > 0.8


def test_empty_clouds_are_unlike_everything() -> None:
    empty = ColumnSpectra.of(describe(np.zeros((0, 3)), SETTINGS)[None])
    distance, _ = compare_descriptors(empty, empty, np.array([0]), np.array([0]))
    assert distance[0] == 1.0


def test_points_on_the_edge_of_the_range_and_of_the_circle_fall_into_bins() -> None:
    edge = np.nextafter(np.float32(80), np.float32(0))
    describe(np.array([[edge, 0.0, 0.0], [5.0, -1e-30, 0.0], [-5.0, -0.0, 0.0]]), SETTINGS)
