"""Paths padded to one width."""

from __future__ import annotations

import numpy as np

from wiclosure.types import AoaPath, WirelessMeasurement
from wiclosure.wiclosure_filter.links.paths import PaddedPaths


def heard(*paths: AoaPath) -> WirelessMeasurement:
    return WirelessMeasurement(0, "a", "b", 5.0, 0.5, paths)


def test_the_strongest_come_first_and_weights_sum_to_one() -> None:
    weak, strong, medium = AoaPath(0.1, 0.2, 1.0), AoaPath(0.2, 0.3, 3.0, elevation=0.4), AoaPath(0.3, 0.1, 2.0)
    paths = PaddedPaths.strongest([heard(weak, strong, medium), heard(weak)], np.array([True, True]), max_paths=2)
    assert paths.index.tolist() == [[1, 2], [0, -1]]
    np.testing.assert_allclose(paths.weight, [[0.6, 0.4], [1.0, 0.0]])
    np.testing.assert_allclose(paths.azimuth, [[0.2, 0.3], [0.1, 0.0]])
    np.testing.assert_allclose(paths.sigma, [[0.3, 0.1], [0.2, 1.0]])
    np.testing.assert_allclose(paths.elevation, [[0.4, np.nan], [np.nan, np.nan]])


def test_paths_without_weights_count_alike() -> None:
    paths = PaddedPaths.strongest([heard(*(AoaPath(0.1 * k, 0.2, 0.0) for k in range(4)))], np.array([True]), 16)
    np.testing.assert_allclose(paths.weight, 0.25)


def test_without_known_axes_no_path_is_kept() -> None:
    paths = PaddedPaths.strongest([heard(AoaPath(0.1, 0.2))], np.array([False]), 16)
    assert paths.index.tolist() == [[-1]]
    assert paths.weight.sum() == 0
    assert PaddedPaths.strongest([], np.zeros(0, bool), 16).index.shape == (0, 1)
