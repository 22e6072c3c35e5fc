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
