"""Folders of clouds: order, times beside them, layouts, and what is said of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.bin import LAYOUTS, record_type
from wiclosure.pipeline.sources.folder import FolderSource
from wiclosure.pipeline.sources.info import recording_info

from .clouds.test_record_size import records, street


def write(folder: Path, names: list[str]) -> Path:
    folder.mkdir(exist_ok=True)
    for number, name in enumerate(names):
        np.full((3, 4), number + 1, "<f4").tofile(folder / name)
    return folder


def order(folder: Path) -> list[float]:
    return [float(scan.points[0, 0]) - 1 for scan in FolderSource(folder)]


def test_unpadded_numbers_are_in_their_order(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = write(tmp_path / "lidar", [f"lidar_pointcloud_{k}.bin" for k in range(25)])
    assert order(folder) == list(range(25))
    assert "made up (frame numbers at 10 Hz)" in caplog.text
    assert recording_info(folder).notes == (
        "Stamps: frame numbers at 10 Hz (made up: nothing tells when the clouds were taken).",
    )


@pytest.mark.parametrize("name", ["times.txt", "timestamps.txt"])
@pytest.mark.parametrize("beside", [True, False])
@pytest.mark.parametrize("unit", ["s", "ns", "date"])
def test_a_file_of_times(tmp_path: Path, name: str, beside: bool, unit: str, caplog: pytest.LogCaptureFixture) -> None:
    folder = write(tmp_path / "lidar", [f"s_{k}.bin" for k in range(12)])
    stamps_ns = [1_700_000_000 * 10**9 + k * 99_000_000 for k in range(12)]
    lines = {
        "s": [f"{ns // 10**9}.{ns % 10**9:09d}" for ns in stamps_ns],
        "ns": list(map(str, stamps_ns)),
        "date": [str(np.datetime64(ns, "ns")).replace("T", " ") for ns in stamps_ns],
    }
    ((tmp_path if beside else folder) / name).write_text("\n".join(lines[unit]) + "\n")
    assert [scan.stamp_ns for scan in FolderSource(folder)] == stamps_ns
    assert order(folder) == list(range(12))
    assert "made up" not in caplog.text


def test_times_that_do_not_fit_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = write(tmp_path / "lidar", [f"s_{k}.bin" for k in range(3)])
    (tmp_path / "times.txt").write_text("0\n1\n")
    assert [scan.stamp_ns for scan in FolderSource(folder)] == [0, 10**8, 2 * 10**8]
    assert "has 2 times for the 3 clouds" in caplog.text


@pytest.mark.parametrize("layout", [name for name in LAYOUTS if name not in {"kitti", "xyz"}])
def test_records_of_another_layout_are_refused_and_read_where_declared(tmp_path: Path, layout: str) -> None:
    rows = records(layout)
    rows.tofile(tmp_path / "000000.bin")
    with pytest.raises(InputError, match=f"look like records of {rows.itemsize} bytes, as .*dataset.yaml") as caught:
        FolderSource(tmp_path)
    named = str(caught.value).partition(" bytes, as ")[2].partition(" has")[0].partition(" have")[0].split(" or ")
    assert layout in named
    assert len(named) <= 2
    (scan,) = FolderSource(tmp_path, layout)
    np.testing.assert_allclose(scan.points, np.column_stack([street(6000)[axis] for axis in "xyz"]), rtol=1e-6)
    if "time" in (record_type(layout).names or ()):
        assert scan.times is not None
        np.testing.assert_allclose(scan.times, street(6000)["time"], atol=1e-7)


def test_a_wrong_declaration_is_refused_too(tmp_path: Path) -> None:
    records("nuscenes").tofile(tmp_path / "000000.bin")
    with pytest.raises(InputError, match=r"not records of the layout 'boreas'.*20 bytes, as nuscenes"):
        FolderSource(tmp_path, "boreas")


@pytest.mark.parametrize("shuffled", [False, True])
@pytest.mark.parametrize("intensity", ["none", "bytes", "shares"])
def test_kittis_own_layout_is_taken(tmp_path: Path, shuffled: bool, intensity: str) -> None:
    rows = records("kitti")
    rows["intensity"] = {"none": 0, "bytes": rows["intensity"], "shares": rows["intensity"] / 120}[intensity]
    (np.random.default_rng(0).permutation(rows) if shuffled else rows).tofile(tmp_path / "000000.bin")
    (scan,) = FolderSource(tmp_path)
    assert len(scan.points) == 6000


def test_numbers_that_are_no_coordinates_are_refused_in_small_files_too(tmp_path: Path) -> None:
    np.random.default_rng(0).normal(0, 20, (16, 4)).astype("<f8").tofile(tmp_path / "0.bin")
    with pytest.raises(InputError, match="hold no proper numbers"):
        FolderSource(tmp_path)


def test_las(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    rng = np.random.default_rng(0)
    points = np.round(rng.uniform(-30, 30, (200, 3)), 3)
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 0.001)
    for suffix in (".las", ".laz"):
        cloud = laspy.LasData(header)
        cloud.x, cloud.y, cloud.z = points.T
        cloud.intensity = np.arange(200)
        cloud.gps_time = 300_000 + np.linspace(0, 0.1, 200)
        (tmp_path / suffix).mkdir()
        cloud.write(tmp_path / suffix / f"1700000000_0{suffix}")
        (scan,) = FolderSource(tmp_path / suffix)
        np.testing.assert_allclose(scan.points, points, atol=1e-9)
        np.testing.assert_array_equal(scan.intensity, np.arange(200))
        np.testing.assert_allclose(scan.times, np.linspace(0, 0.1, 200), atol=1e-6)
        assert scan.stamp_ns == 1_700_000_000 * 10**9
        (tmp_path / suffix / f"1700000000_0{suffix}").write_bytes(b"LASF" + bytes(100))
        with pytest.raises(InputError, match="cannot be read as LAS"):
            list(FolderSource(tmp_path / suffix))


@pytest.mark.parametrize("unit_ns", [10**3, 10**6])
def test_times_since_1970_in_smaller_units(tmp_path: Path, unit_ns: int) -> None:
    folder = write(tmp_path / "lidar", [f"s_{k}.bin" for k in range(4)])
    stamps_ns = [1_700_000_000 * 10**9 + k * 10**8 for k in range(4)]
    (folder / "times.txt").write_text("\ufeff" + "\n".join(str(ns // unit_ns) for ns in stamps_ns), encoding="utf-8")
    assert [scan.stamp_ns for scan in FolderSource(folder)] == stamps_ns


def test_dates_with_a_zone(tmp_path: Path) -> None:
    folder = write(tmp_path / "lidar", ["s_1.bin", "s_2.bin"])
    (folder / "times.txt").write_text("2023-11-14T23:13:20.5+01:00\n2023/11/14 22:13:20.600\n")
    assert [scan.stamp_ns for scan in FolderSource(folder)] == [1_700_000_000_500_000_000, 1_700_000_000_600_000_000]


def test_times_that_lost_their_digits_are_refused(tmp_path: Path) -> None:
    folder = write(tmp_path / "lidar", [f"s_{k}.bin" for k in range(3)])
    (folder / "times.txt").write_text("1.700000e+09\n1.700000e+09\n1.700000e+09\n")
    with pytest.raises(InputError, match=r"times.txt, line 2: the time 1.700000e\+09 stands there again"):
        FolderSource(folder)


@pytest.mark.parametrize(
    ("times", "says"), [("0.5\n100000.5\n200000.5\n", "every 100000 s"), ("7\n7\n8\n", "1 stamps repeat")]
)
def test_stamps_that_no_lidar_has_are_said(
    tmp_path: Path, times: str, says: str, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write(tmp_path / "lidar", [f"s_{k}.bin" for k in range(3)])
    (folder / "times.txt").write_text(times)
    assert len(list(FolderSource(folder))) == 3
    assert says in caplog.text


@pytest.mark.parametrize(
    ("layout", "says"),
    [("x y z time_of_day", "field time_of_day looks like per-point times"), ("x y z time", "field time is the same")],
)
def test_times_that_are_not_used_are_said_once(
    tmp_path: Path, layout: str, says: str, caplog: pytest.LogCaptureFixture
) -> None:
    folder = write(tmp_path / "lidar", [f"s_{k}.bin" for k in range(3)])
    assert all(scan.times is None for scan in FolderSource(folder, layout))
    assert caplog.text.count("not deskewed") == 1
    assert says in caplog.text
