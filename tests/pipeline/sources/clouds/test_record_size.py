"""The length of records by their bytes: known layouts, in the order of the beams and shuffled."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.pipeline.sources.clouds.bin import LAYOUTS, record_type
from wiclosure.pipeline.sources.clouds.record_size import likely_record_size


def street(count: int) -> dict[str, np.ndarray]:
    """What a spinning LiDAR with 32 beams sees of a street, and the usual other fields."""
    rng = np.random.default_rng(3)
    ring, turn = np.arange(count) % 32, np.linspace(0, 2 * np.pi, count)
    elevation = np.deg2rad(-25 + ring)
    level = np.minimum(1.8 / np.maximum(np.tan(-elevation), 0.05), 8 / np.maximum(np.abs(np.sin(turn)), 0.1))
    level = level * rng.normal(1, 0.01, count)
    return {
        "x": level * np.cos(turn), "y": level * np.sin(turn), "z": level * np.tan(elevation),
        "intensity": rng.integers(0, 120, count), "ring": ring, "time": np.linspace(0, 0.1, count),
        "reflectivity": rng.integers(0, 120, count), "ambient": rng.integers(0, 3000, count),
        "range": level * 1000, "tag": 0 * ring + 16, "line": ring % 6, "velocity": np.cos(turn) * 7,
    }  # fmt: skip


def records(layout: str, count: int = 6000) -> np.ndarray:
    dtype = record_type(layout)
    rows = np.zeros(count, dtype)
    for name, values in street(count).items():
        if name in (dtype.names or ()):
            integer = name == "time" and dtype[name].kind in "iu"
            rows[name] = values * 1e9 if integer else values
    return rows


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("shuffled", [False, True])
def test_the_length_of_known_layouts_is_found(layout: str, shuffled: bool) -> None:
    rows = records(layout)
    if shuffled:
        rows = np.random.default_rng(0).permutation(rows)
    found = likely_record_size(rows.tobytes(), 16)
    assert found == rows.itemsize


def test_a_quarter_of_float32_padded_as_the_point_cloud_library_does() -> None:
    rows = np.zeros((6000, 8), "<f4")
    rows[:, :3] = np.column_stack([street(6000)[axis] for axis in "xyz"])
    rows[:, 3], rows[:, 4] = 1, street(6000)["intensity"]
    assert likely_record_size(rows.tobytes(), 16) == 32


@pytest.mark.parametrize("count", [0, 1, 100])
def test_few_bytes_tell_nothing(count: int) -> None:
    assert likely_record_size(records("nuscenes", max(count, 1))[:count].tobytes(), 16) is None


@pytest.mark.parametrize("seed", range(20))
def test_noise_tells_nothing(seed: int) -> None:
    rows = np.random.default_rng(seed).normal(0, 20, (2000, 4)).astype("<f4")
    assert likely_record_size(rows.tobytes(), 16) in {None, 16}
