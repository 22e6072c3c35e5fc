"""Ground truth of KITTI folders; TUM files and other clocks are tested with data sets (test_dataset.py)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.ground_truth import kitti_ground_truth, read_kitti_poses, recorded_ground_truth
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.types import FloatArray, Scan


def turned(count: int = 3) -> FloatArray:
    yaw = np.arange(count) * 0.1
    return se3.from_yaw(yaw, np.stack([yaw, 0 * yaw, 0 * yaw], axis=1))


def test_rotations_printed_with_three_digits_are_made_exact(tmp_path: Path) -> None:
    rows = turned()[:, :3].reshape(-1, 12)
    (tmp_path / "poses.txt").write_text("".join(" ".join(f"{x:.3f}" for x in row) + "\n" for row in rows))
    R = read_kitti_poses(tmp_path / "poses.txt")[:, :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12)
    assert Rotation.from_matrix(R[2]).as_euler("zyx")[0] == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("1 0 0 5 0 1 0 5 0 0 1", "line 2: expected 12 numbers"),
        ("1 0 0 5 0 1 0 5 0 0 1 far", "line 2: expected 12 numbers"),
        ("1 0 0 5 0 1 0 5 0 0 1 inf", "line 2: not finite"),
        ("2 0 0 5 0 2 0 5 0 0 2 5", "line 2: not a pose"),
        ("1 0 0 5 0 1 0 5 0 0 -1 5", "line 2: not a pose"),
    ],
)
def test_what_is_no_pose_is_named_with_its_line(tmp_path: Path, line: str, says: str) -> None:
    (tmp_path / "poses.txt").write_text(f"1 0 0 5 0 1 0 5 0 0 1 5\n{line}\n")
    with pytest.raises(InputError, match=rf"poses\.txt, {says}"):
        read_kitti_poses(tmp_path / "poses.txt")


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
