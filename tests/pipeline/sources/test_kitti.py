"""KITTI folders and folders of clouds: stamps, missing scans, bad files."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.sources.clouds.file_stamps import stamps_of_names
from wiclosure.pipeline.sources.info import recording_info
from wiclosure.pipeline.sources.open import open_source
from wiclosure.types import Scan


@pytest.fixture
def kitti(tmp_path: Path, scans: list[Scan]) -> Path:
    write_kitti_folder(tmp_path / "08", scans)
    return tmp_path / "08"


def test_stamps_as_numpy_writes_them(kitti: Path) -> None:
    np.savetxt(kitti / "times.txt", np.arange(6) * 0.1037)  # '1.037000000000000088e-01'
    assert [scan.stamp_ns for scan in open_source(kitti)] == [round(i * 103_700_000) for i in range(6)]


def test_missing_scans_are_matched_by_number(kitti: Path, scans: list[Scan]) -> None:
    (kitti / "velodyne" / "000002.bin").unlink()
    source = open_source(kitti)
    assert [s.stamp_ns for s in source] == [s.stamp_ns for i, s in enumerate(scans) if i != 2]


def test_files_that_other_systems_leave_beside_are_no_scans(kitti: Path, scans: list[Scan]) -> None:
    (kitti / "velodyne" / "._000002.bin").write_bytes(b"\0\5\x16\7" + bytes(60))
    assert [s.stamp_ns for s in open_source(kitti)] == [s.stamp_ns for s in scans]


def test_fewer_times_than_scans(kitti: Path) -> None:
    (kitti / "times.txt").write_text("0\n0.1\n")
    with pytest.raises(InputError, match=r"times\.txt has 2 times for 6 scans"):
        open_source(kitti)


@pytest.mark.parametrize(
    ("content", "says"), [(b"0\nabc\n", "line 2: 'abc'"), (b"\xff\xfe\x00", "not text"), (None, "10 scans a second")]
)
def test_bad_times(kitti: Path, content: bytes | None, says: str) -> None:
    (kitti / "times.txt").unlink()
    if content is not None:
        (kitti / "times.txt").write_bytes(content)
    with pytest.raises(InputError, match=says) as caught:
        open_source(kitti)
    assert "times.txt" in str(caught.value)
    assert len(open_source(kitti / "velodyne")) == 6  # the way out


def raw_drive(folder: Path, kept: list[int], blank: list[int], lines: int = 20) -> Path:
    """Scans of these numbers; blank lines are scans that the drive misses."""
    data = folder / "drive_sync" / "velodyne_points"
    (data / "data").mkdir(parents=True)
    for number in kept:
        np.full((5, 4), number + 1, "<f4").tofile(data / "data" / f"{number:010d}.bin")
    texts = ["" if k in blank else f"2011-09-26 13:02:{25 + k / 10:012.9f}" for k in range(lines)]
    (data / "timestamps.txt").write_text("\n".join(texts) + "\n")
    return folder / "drive_sync"


@pytest.mark.parametrize(
    ("kept", "blank"),
    [
        ([k for k in range(20) if k not in {6, 7, 8, 9}], [6, 7, 8, 9]),
        ([0, 1, 2, 3, 12, 13], [6, 7, 8, 9]),
        ([14, 15, 16, 17, 18, 19], [6, 7, 8, 9]),
        ([0, 1], []),
        ([18, 19], [0]),
    ],
)
def test_the_number_of_a_scan_is_its_line_blank_ones_counted(tmp_path: Path, kept: list[int], blank: list[int]) -> None:
    read = list(open_source(raw_drive(tmp_path, kept, blank)))
    first_ns = int(np.datetime64("2011-09-26T13:02:25", "ns").astype(np.int64))
    assert [scan.stamp_ns - first_ns for scan in read] == [k * 10**8 for k in kept]
    assert [scan.points[0, 0] for scan in read] == [k + 1 for k in kept]


def test_a_scan_whose_line_is_blank_is_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read = list(open_source(raw_drive(tmp_path, list(range(20)), [6])))
    assert [scan.points[0, 0] for scan in read] == [k + 1 for k in range(20) if k != 6]
    assert "1 scans have no time, as that of line 7; they are left out" in caplog.text


def test_scans_whose_lines_are_blank_are_refused_where_they_are_many(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"18 times for 3 scans .*0000000006\.bin.* \(2 of its lines are blank\)"):
        open_source(raw_drive(tmp_path, [4, 5, 6], [5, 6]))


def test_a_scan_of_odd_size(kitti: Path) -> None:
    path = kitti / "velodyne" / "000003.bin"
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(InputError, match=r"000003\.bin has 4795 bytes, not a multiple of 16"):
        list(open_source(kitti))


def test_no_scans(kitti: Path) -> None:
    shutil.rmtree(kitti / "velodyne")
    (kitti / "velodyne").mkdir()
    with pytest.raises(InputError, match=r"holds no \.bin scans"):
        open_source(kitti)


def test_the_official_layout_names_its_sequences(tmp_path: Path, scans: list[Scan]) -> None:
    for number in ("00", "08"):
        write_kitti_folder(tmp_path / "dataset" / "sequences" / number, scans)
    assert len(open_source(tmp_path / "dataset" / "sequences" / "08")) == 6
    for folder in (tmp_path / "dataset", tmp_path / "dataset" / "sequences"):
        with pytest.raises(InputError, match=r"name one of them: .*sequences/00, .*sequences/08"):
            open_source(folder)


def test_points_that_are_no_returns_are_dropped(kitti: Path) -> None:
    rows = np.array([[1, 2, 3, 0.5], [0, 0, 0, 0.1], [np.nan, 1, 1, 0.2], [4, 0, 0, 0.7]], "<f4")
    rows.tofile(kitti / "velodyne" / "000000.bin")
    scan = next(iter(open_source(kitti)))
    np.testing.assert_array_equal(scan.points, [[1, 2, 3], [4, 0, 0]])
    np.testing.assert_allclose(scan.intensity, [0.5, 0.7])


def test_info(kitti: Path) -> None:
    info = recording_info(kitti)
    assert (info.kind, info.count, info.topics) == ("KITTI folder", 6, ())
    assert info.duration_s == pytest.approx(0.5)
    assert recording_info(kitti / "velodyne").kind == "folder of .bin files"


@pytest.mark.parametrize(
    ("names", "stamps_ns"),
    [
        (["000000", "000001", "000004"], [0, 10**8, 4 * 10**8]),
        (["1317042272.123456789", "1317042272.223456789"], [1317042272123456789, 1317042272223456789]),
        (["1317042272_123456789"], [1317042272123456789]),
        (["12.5", "12.25"], [12_500_000_000, 12_250_000_000]),
        (["1317042272123456789"], [1317042272123456789]),
        (["1317042272123456"], [1317042272123456000]),
        (["1317042272123"], [1317042272123000000]),
        (["1317042272", "1317042273"], [1317042272 * 10**9, 1317042273 * 10**9]),
        (["scan_a", "scan_b"], [0, 10**8]),
    ],
)
def test_stamps_by_file_names(names: list[str], stamps_ns: list[int]) -> None:
    assert stamps_of_names(names).stamps_ns.tolist() == stamps_ns


def test_files_are_taken_in_order_of_time(tmp_path: Path, scans: list[Scan]) -> None:
    for number in (10, 9):
        np.full((2, 4), number, "<f4").tofile(tmp_path / f"{number}.bin")
    assert [scan.points[0, 0] for scan in open_source(tmp_path)] == [9, 10]


def test_a_folder_of_two_kinds(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(bytes(16))
    (tmp_path / "a.ply").write_bytes(b"ply")
    with pytest.raises(InputError, match=r"holds \.bin and \.ply"):
        open_source(tmp_path)


@pytest.mark.parametrize("name", ["a.ply", "a.pcd"])
def test_a_cloud_that_open3d_cannot_read(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"nothing of the kind")
    with pytest.raises(InputError, match=name):
        list(open_source(tmp_path))


def test_per_point_times_of_a_pcd(tmp_path: Path) -> None:
    rows = "\n".join(f"{i + 1} 0 {i % 3} {i * 1_000_000}" for i in range(100))
    (tmp_path / "1700000000000000000.pcd").write_text(
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z t\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 100\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 100\nDATA ascii\n{rows}\n"
    )
    scan = next(iter(open_source(tmp_path)))
    np.testing.assert_allclose(scan.times, np.arange(100) * 0.001, atol=1e-9)
