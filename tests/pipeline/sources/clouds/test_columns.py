from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.columns import returns, text_numbers, wanted

CLOUD = Path("a.ply")


def test_axes_times_and_intensity_by_the_names_of_drivers() -> None:
    found = wanted(CLOUD, ["X", "Y", "Z", "nx", "reflectivity", "offset_time"])
    assert found == ("X", "Y", "Z", "offset_time", "reflectivity")
    assert found.names == ("X", "Y", "Z", "offset_time", "reflectivity")
    assert wanted(CLOUD, ["z", "y", "x"]) == ("x", "y", "z", None, None)


@pytest.mark.parametrize(
    ("names", "says"), [(["x", "y"], "no field 'z' (fields: x, y)"), ([], "no field 'x' (fields: none)")]
)
def test_no_points_without_all_axes(names: list[str], says: str) -> None:
    with pytest.raises(InputError) as raised:
        wanted(CLOUD, names)
    assert says in str(raised.value)


def test_only_returns_are_kept_and_values_keep_their_types() -> None:
    columns = {
        "x": np.array([1, np.inf, 0, 3], np.float32), "y": np.array([1, 1, 0, 3], np.float32),
        "z": np.array([1, 1, 0, 3], np.float32), "t": np.array([1, 2, 3, 4], np.uint32),
        "i": np.array([5, 6, 7, 8], np.uint8),
    }  # fmt: skip
    cloud = returns(columns, wanted(CLOUD, columns))
    np.testing.assert_array_equal(cloud.points, [[1, 1, 1], [3, 3, 3]])
    assert (cloud.points.dtype, cloud.times.dtype, cloud.intensity.dtype) == (np.float64, np.uint32, np.uint8)
    assert (cloud.times.tolist(), cloud.intensity.tolist()) == ([1, 4], [5, 8])


def test_a_whole_cloud_does_not_share_memory_with_the_file() -> None:
    columns = {name: np.ones(3, np.float32) for name in ("x", "y", "z", "t")}
    cloud = returns(columns, wanted(CLOUD, columns))
    columns["t"][0] = 9.0
    assert cloud.times.tolist() == [1.0, 1.0, 1.0]


def test_numbers_in_text() -> None:
    np.testing.assert_array_equal(text_numbers(CLOUD, b"1 2\n3 4\n5 6\nmore", 3, 2), [[1, 2], [3, 4], [5, 6]])
    with pytest.raises(InputError, match=r"a\.ply is cut short: 3 points are announced, 2 there"):
        text_numbers(CLOUD, b"1 2 3 4 5", 3, 2)
    with pytest.raises(InputError, match="holds what is no number"):
        text_numbers(CLOUD, b"1 2 x 4", 2, 2)


@pytest.mark.parametrize("count", [3, 10**40])
def test_fewer_numbers_than_announced_are_said(count: int) -> None:
    with pytest.raises(InputError, match=rf"a\.pcd is cut short: {count} points are announced, 2 there"):
        text_numbers(Path("a.pcd"), b"1 2 3 4 5 6 7", count, 3)
