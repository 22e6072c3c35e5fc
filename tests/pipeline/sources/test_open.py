"""Every source: announces its scans, gives the same twice, and gives what was recorded."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.radio.radio_units import LengthUnit
from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.open import open_source
from wiclosure.types import Scan

Make = Callable[[Path, list[Scan], dict[str, Path]], Path]


def kitti_raw(folder: Path, scans: list[Scan]) -> Path:
    write_kitti_folder(folder / "odometry", scans)
    data = folder / "drive_sync" / "velodyne_points"
    data.mkdir(parents=True)
    shutil.move(folder / "odometry" / "velodyne", data / "data")
    stamps = [str(np.datetime64(scan.stamp_ns, "ns")).replace("T", " ") for scan in scans]
    (data / "timestamps.txt").write_text("\n".join(stamps) + "\n")
    return folder / "drive_sync"


def cloud_files(folder: Path, scans: list[Scan], suffix: str) -> Path:
    import open3d as o3d

    folder = folder / "clouds"
    folder.mkdir()
    for scan in scans:
        cloud = o3d.t.geometry.PointCloud(scan.points.astype(np.float32))
        assert scan.intensity is not None
        cloud.point["intensity"] = scan.intensity[:, None]
        assert o3d.t.io.write_point_cloud(str(folder / f"{scan.stamp_ns}{suffix}"), cloud)
    return folder


def without_metadata(folder: Path, bag: Path) -> Path:
    copy = folder / "bare"
    shutil.copytree(bag, copy)
    (copy / "metadata.yaml").unlink()
    return copy


def file_in(bag: Path) -> Path:
    return next(file for file in bag.iterdir() if file.suffix in {".mcap", ".db3"})


def kitti_odometry(folder: Path, scans: list[Scan]) -> Path:
    write_kitti_folder(folder / "08", scans)
    return folder / "08"


RECORDINGS: dict[str, Make] = {
    "ros1": lambda folder, scans, bags: bags["ros1"],
    "ros2 mcap": lambda folder, scans, bags: bags["mcap"],
    "ros2 sqlite3": lambda folder, scans, bags: bags["sqlite3"],
    "ros2 mcap without metadata": lambda folder, scans, bags: without_metadata(folder, bags["mcap"]),
    "ros2 sqlite3 without metadata": lambda folder, scans, bags: without_metadata(folder, bags["sqlite3"]),
    "mcap file": lambda folder, scans, bags: file_in(bags["mcap"]),
    "db3 file": lambda folder, scans, bags: file_in(bags["sqlite3"]),
    "kitti odometry": lambda folder, scans, bags: kitti_odometry(folder, scans),
    "kitti raw": lambda folder, scans, bags: kitti_raw(folder, scans),
    "bin": lambda folder, scans, bags: kitti_odometry(folder, scans) / "velodyne",
    "pcd": lambda folder, scans, bags: cloud_files(folder, scans, ".pcd"),
    "ply": lambda folder, scans, bags: cloud_files(folder, scans, ".ply"),
}


@pytest.fixture(params=RECORDINGS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def recording(kind: str, tmp_path: Path, scans: list[Scan], bags: dict[str, Path]) -> Path:
    return RECORDINGS[kind](tmp_path, scans, bags)


def test_every_source_gives_what_was_recorded_twice(recording: Path, kind: str, scans: list[Scan]) -> None:
    source = open_source(recording)
    assert isinstance(source, ScanSource)
    assert len(source) == len(scans)
    assert str(recording) in source.description
    for _ in range(2):
        read = list(source)
        assert [scan.stamp_ns for scan in read] == [scan.stamp_ns for scan in scans]
        for scan, original in zip(read, scans, strict=True):
            np.testing.assert_array_equal(scan.points, original.points)
            np.testing.assert_array_equal(scan.intensity, original.intensity)
            if kind in {"ros1", "ros2 mcap", "ros2 sqlite3"}:
                np.testing.assert_array_equal(scan.times, original.times)


def test_limit_and_time_offset(recording: Path, scans: list[Scan]) -> None:
    whole = list(open_source(recording))
    source = open_source(recording, limit=4, time_offset=-1.5)
    assert len(source) == 4
    assert [scan.stamp_ns for scan in source] == [scan.stamp_ns - 1_500_000_000 for scan in whole[:4]]
    assert "first 4" in source.description


def test_bad_limit(bags: dict[str, Path]) -> None:
    with pytest.raises(ConfigError, match="0"):
        open_source(bags["ros1"], limit=0)


def test_a_topic_of_what_is_no_bag_is_refused(recording: Path) -> None:
    if bag_kind(recording) is None:
        with pytest.raises(InputError, match="is no bag and has no topic /points"):
            open_source(recording, topic="/points")


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda folder: folder / "gone.bag", "does not exist"),
        (lambda folder: folder, "supported"),
        (lambda folder: _file(folder / "notes.txt", b"hello"), "supported"),
        (lambda folder: _file(folder / "text.bag", b"no bag at all, but long enough for a look"), "supported"),
        (lambda folder: _file(folder / "empty.bag", b""), "empty"),
        (lambda folder: _file(folder / "empty.mcap", b""), "empty"),
        (lambda folder: _file(folder / "old.bag", b"#ROSBAG V1.2\n" + bytes(50)), "supported"),
    ],
)
def test_what_is_no_recording_is_named(tmp_path: Path, make: Callable[[Path], Path], says: str) -> None:
    path = make(tmp_path)
    with pytest.raises(InputError, match=says) as caught:
        open_source(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def _file(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def around(centre: tuple[float, float, float] = (0.0, 0.0, 0.0), factor: float = 1.0) -> list[Scan]:
    rng = np.random.default_rng(0)
    clouds = [factor * rng.normal(0, 20, (500, 3)) + np.array(centre) for _ in range(3)]
    return [Scan(n * 10**8, cloud, None, np.zeros(500, np.float32)) for n, cloud in enumerate(clouds, 1)]


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1000.0), ("cm", 100.0)])
def test_clouds_in_another_unit_are_refused_and_read_where_it_is_named(
    tmp_path: Path, unit: LengthUnit, factor: float
) -> None:
    path = cloud_files(tmp_path, around(factor=factor), ".pcd")
    with pytest.raises(InputError, match=r"where no LiDAR sees: in mm it is .* add scan_unit: mm, or cm, to this"):
        list(open_source(path))
    for scan, original in zip(open_source(path, unit=unit), around(), strict=True):
        np.testing.assert_allclose(scan.points, original.points, atol=1e-3)
    assert len(list(open_source(path, unit="m"))) == 3


def test_clouds_of_a_map_are_refused(tmp_path: Path) -> None:
    path = cloud_files(tmp_path, around((4e5, 5e6, 0.0)), ".ply")
    with pytest.raises(InputError, match="coordinates of a map; scans must be in the sensor's own"):
        list(open_source(path))


def test_a_folder_of_recordings_is_told_from_one(tmp_path: Path) -> None:
    cloud_files(tmp_path, around(), ".pcd")
    with pytest.raises(InputError, match="name one of the recordings in it: clouds; supported"):
        open_source(tmp_path)


def test_hidden_files_are_no_clouds(tmp_path: Path) -> None:
    path = cloud_files(tmp_path, around(), ".ply")
    (path / "._000001.ply").write_bytes(b"of another system")
    assert len(list(open_source(path))) == 3


def test_what_never_ends_is_no_recording(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.bag")
    with pytest.raises(InputError, match=r"a\.bag is neither a file nor a folder"):
        open_source(tmp_path / "a.bag")
    folder = tmp_path / "clouds"
    folder.mkdir()
    os.mkfifo(folder / "2.bin")
    np.ones((5, 4), "<f4").tofile(folder / "1.bin")
    assert len(list(open_source(folder))) == 1
