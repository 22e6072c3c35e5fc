from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError, OutputError
from wiclosure.formats.radio.radio_units import stamp_ns
from wiclosure.formats.trajectories.kitti_poses import read_kitti_poses, write_kitti_poses
from wiclosure.formats.trajectories.trajectory_file import read_trajectory


def test_poses_come_back_to_the_last_digit(tmp_path: Path) -> None:
    poses = se3.exp(np.random.default_rng(0).normal(size=(20, 6)) * np.repeat([1.0, 1000.0], 3))
    write_kitti_poses(tmp_path / "poses.txt", poses)
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "poses.txt").reshape(20, 3, 4), poses[:, :3])


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere"):
        write_kitti_poses(tmp_path / "nowhere" / "poses.txt", np.eye(4)[None])


@pytest.mark.parametrize("rows", [3, 4])
@pytest.mark.parametrize("numbered", [False, True])
def test_poses_are_read_with_their_frames(tmp_path: Path, rows: int, numbered: bool) -> None:
    poses = se3.exp(np.random.default_rng(0).normal(size=(5, 6)))
    frames = np.array([1, 2, 5, 6, 9])
    lines = [
        (f"{frame} " if numbered else "") + " ".join(map(repr, pose[:rows].reshape(-1).tolist()))
        for frame, pose in zip(frames.tolist(), poses, strict=True)
    ]
    (tmp_path / "poses.txt").write_text("\n".join(lines) + "\n\n")
    read = read_kitti_poses(tmp_path / "poses.txt")
    np.testing.assert_allclose(read.poses, poses, atol=1e-12)
    if numbered:
        assert read.frames is not None
        np.testing.assert_array_equal(read.frames, frames)
    else:
        assert read.frames is None


def test_rotations_printed_with_three_digits_are_made_exact(tmp_path: Path) -> None:
    yaw = np.arange(3) * 0.1
    rows = se3.from_yaw(yaw, np.stack([yaw, 0 * yaw, 0 * yaw], axis=1))[:, :3].reshape(-1, 12)
    (tmp_path / "poses.txt").write_text("".join(" ".join(f"{x:.3f}" for x in row) + "\n" for row in rows))
    R = read_kitti_poses(tmp_path / "poses.txt").poses[:, :3, :3]
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


@pytest.mark.parametrize("first", ["1317042272.123456789", "0.0", "1317042272123456789", "2011-09-26T13:02:25.5"])
def test_stamps_before_the_poses_are_read(tmp_path: Path, first: str) -> None:
    begin_ns = stamp_ns(first, "auto")
    stamps_ns = begin_ns + np.arange(5) * 10**8
    poses = se3.exp(np.random.default_rng(0).normal(size=(5, 6)))
    texts = [f"{ns // 10**9}.{ns % 10**9:09d}" if "." in first else str(ns) for ns in stamps_ns.tolist()]
    (tmp_path / "poses.txt").write_text(
        "".join(
            f"{text} {' '.join(map(repr, pose[:3].ravel().tolist()))}\n"
            for text, pose in zip(texts, poses, strict=True)
        )
    )
    read = read_kitti_poses(tmp_path / "poses.txt")
    assert read.frames is None
    assert read.stamps_ns is not None
    np.testing.assert_array_equal(read.stamps_ns, stamps_ns)
    trajectory = read_trajectory(tmp_path / "poses.txt", "alpha")
    np.testing.assert_array_equal(trajectory.stamps_ns, stamps_ns)
    np.testing.assert_allclose(trajectory.poses, poses, atol=1e-12)


@pytest.mark.parametrize(
    ("second", "says"), [("0.05", "is not after"), ("nan", "neither a frame"), ("1e30", "neither")]
)
def test_first_numbers_that_are_neither_frames_nor_times(tmp_path: Path, second: str, says: str) -> None:
    (tmp_path / "poses.txt").write_text(f"0.1 1 0 0 0 0 1 0 0 0 0 1 0\n{second} 1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(InputError, match=rf"poses\.txt, line 2: .*({says}|not finite)"):
        read_kitti_poses(tmp_path / "poses.txt")


def test_utf_16_is_read_as_utf_8_is(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text("1 0 0 5 0 1 0 0 0 0 1 0\n", encoding="utf-16")
    assert read_kitti_poses(path).poses[0, 0, 3] == 5
