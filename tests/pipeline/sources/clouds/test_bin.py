from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.bin import LAYOUTS, check_layout, read_bin, record_type


def records(layout: str, n: int = 200) -> np.ndarray:
    made, rng = np.zeros(n, record_type(layout)), np.random.default_rng(0)
    for name in made.dtype.names:
        made[name] = rng.uniform(1, 100, n)
    return made


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_is_read_back(tmp_path: Path, layout: str) -> None:
    made = records(layout)
    (tmp_path / "a.bin").write_bytes(made.tobytes())
    cloud = read_bin(tmp_path / "a.bin", layout)
    np.testing.assert_array_equal(cloud.points, np.column_stack([made[axis] for axis in "xyz"]))
    if "time" in made.dtype.names:
        np.testing.assert_array_equal(cloud.times, made["time"])
        assert cloud.times.dtype == made["time"].dtype
    else:
        assert cloud.times is None


def test_points_without_a_return_are_left_out_with_their_times(tmp_path: Path) -> None:
    made = records("boreas", 5)
    made["x"][1] = np.nan
    made[["x", "y", "z"]][3] = (0, 0, 0)
    (tmp_path / "a.bin").write_bytes(made.tobytes())
    cloud = read_bin(tmp_path / "a.bin", "boreas")
    np.testing.assert_array_equal(cloud.times, made["time"][[0, 2, 4]])


def test_fields_of_ones_own(tmp_path: Path) -> None:
    made = records("x:f8 y:f8, z:f8 t:u4")
    assert made.dtype.itemsize == 28
    (tmp_path / "a.bin").write_bytes(made.tobytes())
    np.testing.assert_array_equal(read_bin(tmp_path / "a.bin", "x:f8 y:f8 z:f8 t:u4").times, made["t"])


@pytest.mark.parametrize(
    ("layout", "says"),
    [
        ("x y", "layout 'x y' is not known; give one of kitti, nuscenes"),
        ("x y z x", "each once"),
        ("x y z t:q9", "'t:q9' has an unknown type; expected one of f4, f8"),
        ("velodyne", "layout 'velodyne' is not known"),
    ],
)
def test_what_is_no_layout_is_said(layout: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        record_type(layout)


def test_bytes_that_do_not_fit_are_refused_with_the_way_out(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    path.write_bytes(records("kitti").tobytes()[:-3])
    with pytest.raises(InputError, match=r"a\.bin has 3197 bytes, not a multiple of 16 .*truncated"):
        read_bin(path)
    path.write_bytes(records("doubles").tobytes())
    with pytest.raises(InputError, match=r"lie beyond 1e\+06 m or hold no proper numbers: .*layout"):
        read_bin(path)
    with pytest.raises(InputError, match=r"cannot read the scan .*none\.bin"):
        read_bin(tmp_path / "none.bin")


def test_a_layout_of_another_length_is_noticed_though_its_numbers_look_sound(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    made = np.zeros(4000, record_type("nuscenes"))
    turn = np.linspace(0, 2 * np.pi, 4000)
    made["x"], made["y"] = 20 * np.cos(turn), 20 * np.sin(turn)
    made["z"], made["intensity"], made["ring"] = (
        np.arange(4000) % 32 - 16.0,
        rng.uniform(1, 200, 4000),
        np.arange(4000) % 32,
    )
    (tmp_path / "a.bin").write_bytes(made.tobytes())
    check_layout(tmp_path / "a.bin", "nuscenes")
    with pytest.raises(InputError, match=r"layout: nuscenes in the dataset\.yaml"):
        check_layout(tmp_path / "a.bin", "kitti")


def scene(n: int = 4000) -> np.ndarray:
    """Columns x, y, z, reflectance of a sensor 1.7 m above a street."""
    rng = np.random.default_rng(0)
    columns = [rng.normal(0, 15, n), rng.normal(0, 8, n), rng.uniform(-1.7, 3, n), rng.uniform(0, 1, n)]
    return np.column_stack(columns).astype("<f4")


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ([0, 1, 2, 3], None),
        ([3, 0, 1, 2], "its number 1 is never negative, .* say layout: 'intensity x y z'"),
        ([0, 3, 1, 2], "its number 2 is never negative, .* say layout: 'x intensity y z'"),
        ([1, 2, 0, 3], r"z spreads more \(.*, and y least"),
    ],
)
def test_another_order_of_four_numbers_is_doubted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, order: list[int], says: str | None
) -> None:
    (tmp_path / "a.bin").write_bytes(scene()[:, order].tobytes())
    check_layout(tmp_path / "a.bin")
    assert caplog.text == "" if says is None else re.search(says, caplog.text)
