"""Files of trajectories: what kind each is, and EuRoC's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.trajectories.euroc import read_euroc
from wiclosure.formats.trajectories.trajectory_file import read_trajectory, trajectory_kind

EUROC = (
    "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_x\n"
    "1403636580838555648,4.6,-1.7,0.5,0.7071067811865476,0.0,0.0,0.7071067811865476,0.1\n"
    "1403636580843555584,4.7,-1.7,0.5,1.0,0.0,0.0,0.0,0.1\n"
)


def test_euroc_ground_truth(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text(EUROC)
    read = read_trajectory(tmp_path / "data.csv", "a")
    assert read.stamps_ns.tolist() == [1403636580838555648, 1403636580843555584]
    np.testing.assert_allclose(read.poses[0], se3.from_yaw(np.pi / 2, np.array([4.6, -1.7, 0.5])), atol=1e-12)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("1403636580848555584,4.7,x,0.5,1.0,0.0,0.0,0.0\n", "line 4: expected stamp"),
        ("1403636580848555584,4.7,0.5\n", "line 4: expected stamp"),
        ("1403636580848555584,nan,0,0,1,0,0,0\n", "line 4: expected stamp"),
        ("1403636580848555584,0,0,0,0,0,0,0\n", "line 4: expected stamp"),
        ("1403636580038555584,0,0,0,1,0,0,0\n", "line 4: stamp .* is before"),
    ],
)
def test_a_bad_line_of_euroc_is_named(tmp_path: Path, line: str, says: str) -> None:
    (tmp_path / "data.csv").write_text(EUROC + line)
    with pytest.raises(InputError, match=says):
        read_euroc(tmp_path / "data.csv", "a")


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (EUROC, "euroc"),
        ("# c\n1.0 0 0 0 0 0 0 1\n", "tum"),
        ("1.0,0,0,0,0,0,0,1\n", "tum"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n", "kitti"),
        ("7 1 0 0 0 0 1 0 0 0 0 1 0\n", "kitti"),
        ("", "tum"),
    ],
)
def test_the_kind_of_a_file(tmp_path: Path, text: str, kind: str) -> None:
    (tmp_path / "poses.txt").write_text(text)
    assert trajectory_kind(tmp_path / "poses.txt") == kind


def test_poses_without_stamps_are_no_trajectory(tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    with pytest.raises(InputError, match="carry no stamps"):
        read_trajectory(tmp_path / "poses.txt", "a")
