"""Ground truth of KITTI folders; TUM files and other clocks are tested with data sets (test_dataset.py)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.ground_truth import kitti_ground_truth, recorded_ground_truth
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.types import FloatArray, Scan


def turned(count: int = 3) -> FloatArray:
    yaw = np.arange(count) * 0.1
    return se3.from_yaw(yaw, np.stack([yaw, 0 * yaw, 0 * yaw], axis=1))


def test_a_calibration_that_is_no_matrix_is_named(tmp_path: Path) -> None:
    scans = [Scan(10**9 + k * 10**8, np.ones((5, 3))) for k in range(3)]
    write_kitti_folder(tmp_path / "08", scans, T_world_lidar=turned())
    truth = kitti_ground_truth(tmp_path / "08", "alpha")
    assert truth is not None
    np.testing.assert_array_equal(truth.stamps_ns, [scan.stamp_ns for scan in scans])
    np.testing.assert_allclose(truth.poses, turned(), atol=1e-15)
    (tmp_path / "08" / "calib.txt").write_text("P0: 1 2\nTr: 1 2 3\n")
    with pytest.raises(InputError, match=r"calib\.txt: Tr is not a 3 x 4 matrix"):
        kitti_ground_truth(tmp_path / "08", "alpha")


def test_nothing_is_known_of_a_recording_without_poses(tmp_path: Path) -> None:
    write_kitti_folder(tmp_path / "08", [Scan(10**9, np.ones((5, 3)))])
    assert kitti_ground_truth(tmp_path / "08", "alpha") is None
    assert recorded_ground_truth("alpha", RobotRecording(tmp_path / "08")) is None


# ------------------------------------------------------------------------------------------ poses that are not as many
def kitti(folder: Path, count: int, poses: str) -> Path:
    scans = [Scan(10**9 + k * 10**8, np.full((5, 3), k + 1.0)) for k in range(count)]
    write_kitti_folder(folder / "08", scans)
    (folder / "08" / "poses.txt").write_text(poses)
    return folder / "08"


def line(x: float) -> str:
    return f"1 0 0 {x} 0 1 0 0 0 0 1 0\n"


def test_one_pose_fewer_than_scans_costs_the_last_scan(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    truth = kitti_ground_truth(kitti(tmp_path, 5, "".join(map(line, range(4)))), "alpha")
    assert truth is not None
    np.testing.assert_array_equal(truth.positions[:, 0], range(4))
    assert "4 poses for 5 scans" in caplog.text


def test_poses_with_numbers_of_frames_are_matched_by_them(tmp_path: Path) -> None:
    truth = kitti_ground_truth(kitti(tmp_path, 5, "".join(f"{k} {line(k)}" for k in (1, 2, 4, 9))), "alpha")
    assert truth is not None
    np.testing.assert_array_equal(truth.stamps_ns, 10**9 + np.array([1, 2, 4]) * 10**8)
    np.testing.assert_array_equal(truth.positions[:, 0], [1, 2, 4])


def test_part_of_a_drive_takes_the_poses_of_its_scans(tmp_path: Path) -> None:
    folder = kitti(tmp_path, 8, "".join(map(line, range(8))))
    for number in (0, 1, 2, 5):
        (folder / "velodyne" / f"{number:06d}.bin").unlink()
    truth = kitti_ground_truth(folder, "alpha")
    assert truth is not None
    np.testing.assert_array_equal(truth.stamps_ns, 10**9 + np.array([3, 4, 6, 7]) * 10**8)
    np.testing.assert_array_equal(truth.positions[:, 0], [3, 4, 6, 7])


def test_poses_that_fit_nothing_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="2 poses for 9 scans"):
        kitti_ground_truth(kitti(tmp_path, 9, line(0) + line(1)), "alpha")


def test_a_poses_file_beside_a_folder_of_clouds(tmp_path: Path) -> None:
    folder = kitti(tmp_path, 4, "")
    (tmp_path / "truth.txt").write_text("".join(map(line, range(4))))
    truth = recorded_ground_truth("alpha", RobotRecording(folder / "velodyne", ground_truth=tmp_path / "truth.txt"))
    assert truth is not None
    np.testing.assert_array_equal(truth.positions[:, 0], range(4))


def test_poses_with_stamps_are_matched_with_scans_by_them(tmp_path: Path) -> None:
    of_scans = kitti_ground_truth(
        kitti(tmp_path, 5, "".join(f"{1 + k / 10:.9f} {line(k)}" for k in (1, 2, 4, 9))), "alpha"
    )
    assert of_scans is not None
    np.testing.assert_array_equal(of_scans.stamps_ns, 10**9 + np.array([1, 2, 4]) * 10**8)
    np.testing.assert_array_equal(of_scans.positions[:, 0], [1, 2, 4])
    with pytest.raises(InputError, match="none of its stamps is that of a scan"):
        kitti_ground_truth(kitti(tmp_path / "far", 5, f"77.25 {line(0)}88.25 {line(1)}"), "alpha")


def test_poses_with_stamps_need_no_scans(tmp_path: Path) -> None:
    folder = kitti(tmp_path, 4, "")
    (tmp_path / "truth.txt").write_text("".join(f"{1 + k / 20:.9f} {line(k)}" for k in range(8)))
    truth = recorded_ground_truth("alpha", RobotRecording(folder, ground_truth=tmp_path / "truth.txt"))
    assert truth is not None
    np.testing.assert_array_equal(truth.stamps_ns, 10**9 + np.arange(8) * 50_000_000)


def test_the_clock_of_ground_truth_that_does_not_overlap_is_named(tmp_path: Path) -> None:
    scans = [Scan(1_700_000_000 * 10**9 + k * 10**8, np.full((5, 3), k + 1.0)) for k in range(20)]
    write_kitti_folder(tmp_path / "08", scans)
    (tmp_path / "a.tum").write_text("".join(f"{1_384_035_218 + k / 10:.3f} {k} 0 0 0 0 0 1\n" for k in range(20)))
    with pytest.raises(InputError, match=r"fit as seconds since 1980 \(GPS time\): add 315964782 to them"):
        recorded_ground_truth("alpha", RobotRecording(tmp_path / "08", ground_truth=tmp_path / "a.tum"))


def test_a_name_that_no_file_can_have_is_none(tmp_path: Path) -> None:
    folder = kitti(tmp_path, 4, "")
    with pytest.raises(InputError, match="does not exist"):
        recorded_ground_truth("alpha", RobotRecording(folder, ground_truth=tmp_path / ("9" * 5000)))
