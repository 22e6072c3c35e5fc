from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import OutputError
from wiclosure.formats.kitti_poses import write_kitti_poses


def test_poses_come_back_to_the_last_digit(tmp_path: Path) -> None:
    poses = se3.exp(np.random.default_rng(0).normal(size=(20, 6)) * np.repeat([1.0, 1000.0], 3))
    write_kitti_poses(tmp_path / "poses.txt", poses)
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "poses.txt").reshape(20, 3, 4), poses[:, :3])


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere"):
        write_kitti_poses(tmp_path / "nowhere" / "poses.txt", np.eye(4)[None])
