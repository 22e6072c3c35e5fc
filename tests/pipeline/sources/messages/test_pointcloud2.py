"""The PointCloud2 decoder: layouts, byte orders, padding, dropped points, and what per-point times mean."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.pointcloud2 import FORMATS, PointCloud2Decoder
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE
from wiclosure.types import Scan

STORES = {"ros1": get_typestore(Stores.ROS1_NOETIC), "ros2": get_typestore(Stores.ROS2_HUMBLE)}
DATATYPE = {name: number for number, name in reversed(FORMATS.items())}
STAMP_NS = 1_700_000_000_123_456_789


@dataclass
class Cloud:
    """Builds a message field by field; `columns` are `(height, width)` arrays."""

    columns: dict[str, np.ndarray]
    big_endian: bool = False
    point_padding: int = 0
    row_padding: int = 0
    stamp_ns: int = STAMP_NS
    overrides: dict[str, Any] = field(default_factory=dict)

    def message(self, ros: str = "ros2") -> Any:
        types = STORES[ros].types
        order = ">" if self.big_endian else "<"
        height, width = next(iter(self.columns.values())).shape
        formats = [order + c.dtype.str[1:] for c in self.columns.values()]
        gaps = [self.point_padding] * (len(formats) + 1)
        offsets, end = [], 0
        for gap, fmt in zip(gaps, formats, strict=False):
            offsets.append(end + gap)
            end = offsets[-1] + np.dtype(fmt).itemsize
        step = end + gaps[-1]
        row_step = width * step + self.row_padding
        data = np.full(max((height - 1) * row_step + width * step, 0), 0xA5, np.uint8)
        dtype = np.dtype({"names": list(self.columns), "formats": formats, "offsets": offsets, "itemsize": step})
        records = np.ndarray((height, width), dtype, data.data, strides=(row_step, step))
        for name, column in self.columns.items():
            records[name] = column
        stamp = types["builtin_interfaces/msg/Time"](sec=self.stamp_ns // 10**9, nanosec=self.stamp_ns % 10**9)
        extra = {"seq": 0} if ros == "ros1" else {}
        content = {
            "header": types["std_msgs/msg/Header"](stamp=stamp, frame_id="lidar", **extra),
            "height": height,
            "width": width,
            "fields": [
                types["sensor_msgs/msg/PointField"](
                    name=name, offset=offset, datatype=DATATYPE[np.dtype(fmt).str[1:]], count=1
                )
                for name, offset, fmt in zip(self.columns, offsets, formats, strict=True)
            ],
            "is_bigendian": self.big_endian,
            "point_step": step,
            "row_step": row_step,
            "data": data,
            "is_dense": False,
        }
        message = types[POINT_CLOUD_TYPE](**(content | self.overrides))
        # Through the wire and back, as from a bag.
        store = STORES[ros]
        if ros == "ros1":
            return store.deserialize_ros1(store.serialize_ros1(message, POINT_CLOUD_TYPE), POINT_CLOUD_TYPE)
        return store.deserialize_cdr(store.serialize_cdr(message, POINT_CLOUD_TYPE), POINT_CLOUD_TYPE)


def decode(cloud: Cloud, ros: str = "ros2") -> Scan:
    return PointCloud2Decoder().decode(cloud.message(ros))


def xyz(shape: tuple[int, int] = (1, 50), dtype: str = "f4") -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    return {axis: (rng.uniform(1, 100, shape) * rng.choice([-1, 1], shape)).astype(dtype) for axis in "xyz"}


def stacked(columns: dict[str, np.ndarray]) -> np.ndarray:
    return np.stack([columns[a].reshape(-1).astype(float) for a in "xyz"], axis=1)


@pytest.mark.parametrize("ros", ["ros1", "ros2"])
@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("shape", [(1, 50), (16, 30), (30, 1)])
@pytest.mark.parametrize(("point_padding", "row_padding"), [(0, 0), (3, 0), (4, 7), (0, 16)])
def test_points_survive_any_layout(
    ros: str, big_endian: bool, shape: tuple[int, int], point_padding: int, row_padding: int
) -> None:
    columns = xyz(shape) | {"intensity": np.arange(shape[0] * shape[1], dtype="u2").reshape(shape)}
    scan = decode(Cloud(columns, big_endian, point_padding, row_padding), ros)
    np.testing.assert_array_equal(scan.points, stacked(columns))
    assert scan.intensity is not None
    np.testing.assert_array_equal(scan.intensity, columns["intensity"].reshape(-1))
    assert scan.stamp_ns == STAMP_NS
    assert scan.times is None
    assert scan.points.flags.c_contiguous


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8"])
def test_coordinates_of_any_type(dtype: str) -> None:
    columns = {axis: np.arange(1, 41).reshape(1, 40).astype(dtype) for axis in "zyx"}
    columns["x"][0, 3] = columns["y"][0, 3] = columns["z"][0, 3] = 0
    assert len(decode(Cloud(columns)).points) == 39


@given(
    shape=st.sampled_from([(1, 40), (8, 5), (5, 8)]),
    bad=st.lists(
        st.tuples(st.integers(0, 39), st.sampled_from("xyz0"), st.sampled_from([np.nan, np.inf, -np.inf])), max_size=30
    ),
    row_padding=st.sampled_from([0, 5]),
    big_endian=st.booleans(),
)
@settings(deadline=None)
def test_bad_points_go_together_with_their_time_and_intensity(
    shape: tuple[int, int], bad: list[tuple[int, str, float]], row_padding: int, big_endian: bool
) -> None:
    columns = xyz(shape)
    for index, axis, value in bad:
        for name in "xyz" if axis == "0" else axis:
            columns[name].reshape(-1)[index] = 0 if axis == "0" else value
    number = np.arange(40).reshape(shape)
    columns |= {"intensity": number.astype("f4"), "t": (number * 2_500_000).astype("u4")}
    scan = decode(Cloud(columns, big_endian, 0, row_padding))
    points = stacked(columns)
    good = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)
    np.testing.assert_array_equal(scan.points, points[good])
    np.testing.assert_array_equal(scan.intensity, np.flatnonzero(good))
    if good.sum() > 1:
        np.testing.assert_allclose(scan.times, np.flatnonzero(good) * 0.0025, atol=1e-9)


def test_numbers_beyond_all_places_are_no_returns() -> None:
    columns = xyz()
    columns["y"][0, 7], columns["z"][0, 9] = 3e38, -1e9
    assert len(decode(Cloud(columns)).points) == 48


def test_a_point_on_an_axis_is_kept() -> None:
    columns = {axis: np.zeros((1, 3), "f4") for axis in "xyz"}
    columns["y"][0, 1] = 5
    np.testing.assert_array_equal(decode(Cloud(columns)).points, [[0, 5, 0]])


SWEEP = np.linspace(0, 1, 600).reshape(1, 600)  # share of the sweep at which each point was measured


@pytest.mark.parametrize("name", ["t", "time", "timestamp", "time_stamp", "offset_time"])
@pytest.mark.parametrize("period_s", [0.02, 0.05, 0.1, 1.0])
@pytest.mark.parametrize("start", [0.0, -1.0, -0.5])
@pytest.mark.parametrize(
    ("dtype", "ticks_per_s"),
    [("f4", 1), ("f8", 1), ("f4", 1e6), ("i4", 1e6), ("f8", 1e6), ("f4", 1e9), ("i4", 1e9), ("i8", 1e9), ("f8", 1e9)],
)
def test_relative_times(name: str, period_s: float, start: float, dtype: str, ticks_per_s: float) -> None:
    expected = (SWEEP + start) * period_s
    columns = xyz(SWEEP.shape) | {name: (expected * ticks_per_s).astype(dtype)}
    scan = decode(Cloud(columns))
    assert scan.times is not None
    np.testing.assert_allclose(scan.times, expected[0], atol=max(1.01 / ticks_per_s, 1e-7) if dtype[0] == "i" else 1e-7)


@pytest.mark.parametrize("stamp_s", [1_700_000_000, 1_000_000, 12])
@pytest.mark.parametrize("start", [0.0, -1.0, -0.5])
@pytest.mark.parametrize(
    ("dtype", "ticks_per_s"), [("f8", 1), ("u8", 10**6), ("u8", 10**9), ("f8", 10**9), ("f8", 10**6)]
)
def test_absolute_times(stamp_s: int, start: float, dtype: str, ticks_per_s: int) -> None:
    after_ns = ((SWEEP + start) * 0.1e9).astype(np.int64)
    stamp_ns = stamp_s * 10**9 + 123_456_789
    absolute_ns = stamp_ns + after_ns
    if dtype == "f8":
        recorded = (absolute_ns.astype(np.longdouble) * ticks_per_s / 10**9).astype("f8")
    else:
        recorded = (absolute_ns // (10**9 // ticks_per_s)).astype(dtype)
    scan = decode(Cloud(xyz(SWEEP.shape) | {"timestamp": recorded}, stamp_ns=stamp_ns))
    assert scan.times is not None
    np.testing.assert_allclose(
        scan.times, after_ns[0] * 1e-9, atol=2e-9 if ticks_per_s * dtype.count("u") == 10**9 else 2e-6
    )


def test_a_sensor_with_its_own_clock_starts_at_the_stamp() -> None:
    since_power_on_ns = (3_210 * 10**9 + SWEEP * 0.1e9).astype("u8")
    scan = decode(Cloud(xyz(SWEEP.shape) | {"t": since_power_on_ns}))
    assert scan.times is not None
    np.testing.assert_allclose(scan.times, SWEEP[0] * 0.1, atol=2e-9)


def test_sixty_four_bits_in_two_of_thirty_two() -> None:
    stamps = (STAMP_NS + (SWEEP * 0.1e9).astype(np.int64)).astype("u8")
    message = Cloud(xyz(SWEEP.shape) | {"timestamp": stamps}).message()
    message.fields[3].datatype, message.fields[3].count = 6, 2
    scan = PointCloud2Decoder().decode(message)
    assert scan.times is not None
    np.testing.assert_allclose(scan.times, SWEEP[0] * 0.1, atol=2e-9)


def test_the_unit_is_kept_for_short_sweeps_and_corrected_by_long_ones() -> None:
    decoder = PointCloud2Decoder()

    def times(share: float) -> np.ndarray:
        ticks = (SWEEP * 0.1e9 * share).astype("u4")
        result = decoder.decode(Cloud(xyz(SWEEP.shape) | {"t": ticks}).message()).times
        assert result is not None
        return result

    times(0.005)  # half a millisecond of a cut sweep: no telling
    np.testing.assert_allclose(times(1.0), SWEEP[0] * 0.1, atol=2e-9)
    np.testing.assert_allclose(times(0.001), SWEEP[0] * 0.0001, atol=2e-9)


def test_times_that_say_nothing_are_left_out() -> None:
    assert decode(Cloud(xyz() | {"time": np.zeros((1, 50), "f4")})).times is None
    assert decode(Cloud(xyz() | {"time": np.full((1, 50), np.nan, "f4")})).times is None


def test_times_of_beams_without_return_are_no_numbers(caplog: pytest.LogCaptureFixture) -> None:
    x = np.where(np.arange(40) % 5 == 0, np.nan, 3.0).astype(np.float32)[None]
    times = np.where(np.isnan(x), np.nan, np.linspace(0, 0.1, 40))
    scan = PointCloud2Decoder().decode(Cloud({"x": x, "y": x, "z": x, "time": times}).message())
    assert scan.times is not None
    np.testing.assert_array_equal(scan.times, times[np.isfinite(times)])
    assert "deskewed" not in caplog.text


def test_points_without_a_time_are_dropped_where_others_have_one() -> None:
    time = np.linspace(0, 0.1, 50, dtype="f4").reshape(1, 50)
    time[0, 7] = np.nan
    columns = xyz() | {"time": time, "intensity": np.arange(50, dtype="f4").reshape(1, 50)}
    scan = decode(Cloud(columns))
    assert scan.times is not None
    assert scan.intensity is not None
    assert 7 not in scan.intensity
    assert len(scan.points) == len(scan.times) == len(scan.intensity) == 49


@pytest.mark.parametrize(("wrong_s", "unit"), [(1.2, "f4"), (-1.2, "f4"), (0.25, "f4"), (40.0, "f8")])
def test_a_stray_time_costs_its_point_and_not_the_scan(wrong_s: float, unit: str) -> None:
    time = np.linspace(0, 0.1, 500, dtype=unit).reshape(1, 500)
    time[0, [7, 300]] = wrong_s
    columns = xyz(time.shape) | {"time": time, "intensity": np.arange(500, dtype="f4").reshape(1, 500)}
    scan = decode(Cloud(columns))
    assert scan.times is not None
    assert scan.intensity is not None
    assert set(range(500)) - set(scan.intensity.astype(int).tolist()) == {7, 300}
    np.testing.assert_allclose(scan.times, np.delete(np.linspace(0, 0.1, 500), [7, 300]), atol=1e-7)


def test_many_late_points_are_part_of_the_sweep() -> None:
    time = np.linspace(0, 0.1, 500, dtype="f4").reshape(1, 500)
    time[0, :50] = 0.9
    scan = decode(Cloud(xyz(time.shape) | {"time": time}))
    assert scan.times is not None
    assert len(scan.times) == 500


def test_a_stamp_may_be_given_in_the_place_of_the_headers() -> None:
    assert PointCloud2Decoder().decode(Cloud(xyz()).message(), stamp_ns=77).stamp_ns == 77


def test_a_wrong_row_step_of_a_flat_cloud_does_not_matter() -> None:
    assert len(decode(Cloud(xyz(), overrides={"row_step": 0})).points) == 50
    assert len(decode(Cloud(xyz((4, 10)), overrides={"row_step": 0})).points) == 40


@pytest.mark.parametrize("shape", [(0, 0), (1, 0), (0, 10)])
def test_an_empty_cloud_is_an_empty_scan(shape: tuple[int, int]) -> None:
    scan = decode(Cloud({axis: np.zeros(shape, "f4") for axis in "xyz"}))
    assert scan.points.shape == (0, 3)


def test_damage_is_named() -> None:
    with pytest.raises(InputError, match="no field 'z'"):
        decode(Cloud({axis: np.zeros((1, 3), "f4") for axis in ("x", "y", "range")}))
    with pytest.raises(InputError, match="recording is damaged"):
        decode(Cloud(xyz(), overrides={"width": 51}))
    message = Cloud(xyz()).message()
    message.fields[1].datatype = 99
    with pytest.raises(InputError, match="datatype 99"):
        PointCloud2Decoder().decode(message)
    message.fields[1].datatype, message.fields[1].offset = 7, 10
    with pytest.raises(InputError, match="beyond the point"):
        PointCloud2Decoder().decode(message)


@pytest.mark.parametrize("ros", ["ros1", "ros2"])
@pytest.mark.parametrize("timed", [False, True])
def test_encoded_scans_decode_to_themselves(ros: str, timed: bool) -> None:
    rng = np.random.default_rng(5)
    points = rng.normal(0, 30, (500, 3)).astype(np.float32).astype(float)
    times = np.linspace(-0.1, 0, 500).astype(np.float32).astype(float) if timed else None
    intensity = rng.uniform(size=500).astype(np.float32) if timed else None
    scan = PointCloud2Decoder().decode(encode_scan(Scan(STAMP_NS, points, times, intensity), STORES[ros]))  # type: ignore[arg-type]  # rosbags types its messages loosely
    assert scan.stamp_ns == STAMP_NS
    np.testing.assert_array_equal(scan.points, points)
    np.testing.assert_array_equal(scan.times, times)
    np.testing.assert_array_equal(scan.intensity, intensity)


@pytest.mark.parametrize("big_endian", [True, False])
@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_a_byte_order_that_is_stated_wrong_is_told_by_the_coordinates(
    big_endian: bool, kind: str, caplog: pytest.LogCaptureFixture
) -> None:
    points = np.random.default_rng(1).normal(0, 20, (3, 1, 500)).astype(kind)
    message = Cloud(dict(zip("xyz", points, strict=True)), big_endian=big_endian).message()
    message.is_bigendian = not big_endian
    scan = PointCloud2Decoder().decode(message)
    assert scan.points == pytest.approx(points[:, 0].T, abs=1e-12)
    assert "is_bigendian is wrong" in caplog.text
