from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.trajectories.euroc import is_euroc, read_euroc

START_NS = 1_403_636_580_838_555_648


def line(stamp_ns: int, T: np.ndarray, more: str = "") -> str:
    quat_wxyz = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
    return ",".join([str(stamp_ns), *map(repr, [*T[:3, 3].tolist(), *quat_wxyz.tolist()])]) + more + "\n"


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 20))
def test_poses_written_by_the_formats_own_definition_are_read_back(tmp_path_factory, seed, n):
    rng = np.random.default_rng(seed)
    poses = se3.from_rotation_translation(Rotation.random(n, rng=rng).as_matrix(), rng.normal(0, 1e3, (n, 3)))
    stamps_ns = START_NS + np.cumsum(rng.integers(1, 10**9, n))
    path = tmp_path_factory.mktemp("euroc") / "data.csv"
    path.write_text("#timestamp, ...\n" + "".join(map(line, stamps_ns.tolist(), poses)))
    read = read_euroc(path, "alpha")
    assert read.stamps_ns.tolist() == stamps_ns.tolist()  # to the nanosecond, which a float64 cannot hold
    np.testing.assert_allclose(read.poses, poses, atol=1e-9)


def test_marks_names_blank_lines_and_repeated_stamps(tmp_path: Path) -> None:
    here = np.eye(4)
    there = se3.from_yaw(0.0, np.array([1.0, 0.0, 0.0]))
    text = "\ufefftimestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z\n\n" + line(START_NS, here, ",0.1,0.2") + "# pause\n"
    (tmp_path / "data.csv").write_text(text + line(START_NS, there) + line(START_NS + 10**7, there), encoding="utf-8")
    read = read_euroc(tmp_path / "data.csv", "alpha")
    assert (read.stamps_ns - START_NS).tolist() == [0, 10**7]
    np.testing.assert_array_equal(read.positions[:, 0], [0.0, 1.0])  # the first of two poses of one stamp


@pytest.mark.parametrize(
    ("text", "known"),
    [
        (line(START_NS, np.eye(4)), True),
        (line(START_NS, np.eye(4), ",0.5,0.5,0.5"), True),
        ("1403636580.8,0,0,0,1,0,0,0", False),  # seconds
        ("12,0,0,0,1,0,0,0", False),  # a count, no time since 1970
        (f"{START_NS},0,0,0,1,0,0", False),
        (f"{START_NS} 0 0 0 1 0 0 0", False),
    ],
)
def test_which_lines_are_eurocs(text: str, known: bool) -> None:
    assert is_euroc(text) is known


def test_files_without_poses(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read the trajectory"):
        read_euroc(tmp_path / "missing.csv", "alpha")
    (tmp_path / "data.csv").write_text("#timestamp [ns], x\n")
    with pytest.raises(InputError, match="holds no poses; expected stamp"):
        read_euroc(tmp_path / "data.csv", "alpha")


@pytest.mark.parametrize(
    ("names", "quaternion"),
    [
        ("#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x, q_RS_y, q_RS_z", "0.8,0,0,0.6"),
        ("timestamp,x,y,z,qx,qy,qz,qw", "0,0,0.6,0.8"),
    ],
)  # fmt: skip
def test_names_tell_the_order_of_the_quaternion(tmp_path: Path, names: str, quaternion: str) -> None:
    (tmp_path / "a.csv").write_text(f"{names}\n1700000000000000000,3,2,1,{quaternion}\n")
    trajectory = read_euroc(tmp_path / "a.csv", "alpha")
    np.testing.assert_allclose(trajectory.poses[0, :2, 0], [1 - 2 * 0.6**2, 2 * 0.6 * 0.8], atol=1e-12)


def test_ticks_since_1601_are_told_by_their_size(tmp_path: Path) -> None:
    lines = [f"{133_444_736_000_000_000 + n * 10**6},{n},0,0,1,0,0,0" for n in range(3)]
    (tmp_path / "data.csv").write_text("\n".join(lines))
    read = read_euroc(tmp_path / "data.csv", "alpha")
    np.testing.assert_array_equal(read.stamps_ns, 1_700_000_000 * 10**9 + np.arange(3) * 10**8)


def test_a_line_of_names_may_state_another_unit(tmp_path):
    path = tmp_path / "data.csv"
    rows = [f"{1_700_000_000_000_000 + n * 100_000},{n},0,0,0,0,0,1" for n in range(3)]
    path.write_text("\n".join(["time_us,x,y,z,qx,qy,qz,qw", *rows]) + "\n")
    assert read_euroc(path, "a").stamps_ns.tolist() == [1_700_000_000_000_000_000 + n * 10**8 for n in range(3)]
