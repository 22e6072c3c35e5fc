"""TUM trajectories: round trip, exact stamps, and errors that name the line."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError, OutputError
from wiclosure.formats.stamps import nanoseconds, nanoseconds_of_column, seconds_text
from wiclosure.formats.trajectories.tum import read_tum, write_tum
from wiclosure.types import Trajectory


def random_trajectory(count: int, start_ns: int = 1317042272_123456789) -> Trajectory:
    rng = np.random.default_rng(3)
    stamps_ns = start_ns + np.cumsum(rng.integers(1, 10**9, count))
    rotation = Rotation.random(count, rng=rng).as_matrix()
    return Trajectory("alpha", stamps_ns, se3.from_rotation_translation(rotation, rng.normal(0, 1e3, (count, 3))))


def test_round_trip_keeps_every_nanosecond_and_every_digit(tmp_path: Path) -> None:
    trajectory = random_trajectory(200)
    write_tum(tmp_path / "a.tum", trajectory)
    read = read_tum(tmp_path / "a.tum", "alpha")
    assert read.robot == "alpha"
    np.testing.assert_array_equal(read.stamps_ns, trajectory.stamps_ns)
    np.testing.assert_array_equal(read.positions, trajectory.positions)
    np.testing.assert_allclose(read.poses, trajectory.poses, atol=1e-14)


def test_stamps_before_zero_survive(tmp_path: Path) -> None:
    trajectory = random_trajectory(5, start_ns=-(10**10) - 7)
    write_tum(tmp_path / "a.tum", trajectory)
    np.testing.assert_array_equal(read_tum(tmp_path / "a.tum", "a").stamps_ns, trajectory.stamps_ns)


@given(st.lists(st.integers(0, 9_999_999_999_999_999_999 // 1000), min_size=1, max_size=30))
@settings(deadline=None)
def test_stamp_text_is_exact(stamps_ns: list[int]) -> None:
    text = seconds_text(stamps_ns)
    assert [nanoseconds(t) for t in text] == stamps_ns
    assert nanoseconds_of_column(np.array(text, "S48")).tolist() == stamps_ns


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1e3", 10**12), ("1.3170422720000000e+09", 1317042272 * 10**9), ("5", 5 * 10**9), ("5.", 5 * 10**9),
     (".5", 5 * 10**8), ("-0.5", -5 * 10**8), ("0.0000000019", 2), ("0.12345678949", 123456789)],
)  # fmt: skip
def test_stamps_are_read_in_every_notation(text: str, expected: int) -> None:
    assert nanoseconds(text) == expected
    assert nanoseconds_of_column(np.array([text], "S48")).tolist() == [expected]


def test_comments_blank_lines_and_unnormalised_quaternions_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text("# header\n\n1.5 1 2 3 0 0 0 2\n  # more\n2.5 1 2 4 0 0 0 1 # end\n")
    read = read_tum(tmp_path / "a.tum", "a")
    assert read.stamps_ns.tolist() == [1_500_000_000, 2_500_000_000]
    np.testing.assert_allclose(read.poses[0, :3, :3], np.eye(3))


GOOD = "1.0 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        (GOOD + "# c\n2.0 0 0 0 0 0 0\n", 3, "expected 8 numbers"),
        (GOOD + "2.0,0,0,0,0,0,0,1\n", 2, "separated by spaces"),
        (GOOD + "2.0 0 0 0 0 0 0 1 9\n", 2, "found 9"),
        (GOOD + "2.0 0 x 0 0 0 0 1\n", 2, "y is 'x'"),
        (GOOD + "two 0 0 0 0 0 0 1\n", 2, "'two' is not a number"),
        (GOOD + "1.2.3 0 0 0 0 0 0 1\n", 2, "'1.2.3' is not a number"),
        (GOOD + "nan 0 0 0 0 0 0 1\n", 2, "not finite"),
        (GOOD + "9e99 0 0 0 0 0 0 1\n", 2, "too large"),
        (GOOD + "2.0 0 0 nan 0 0 0 1\n", 2, "z is nan"),
        (GOOD + "2.0 0 0 inf 0 0 0 1\n", 2, "z is inf"),
        (GOOD + "2.0 0 0 0 0 0 0 0\n", 2, "quaternion is zero"),
        (GOOD + "2.0 0 0 0 0 0 0 1\n1.5 0 0 0 0 0 0 1\n", 3, "before that of line 2"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, text: str, line: int, says: str) -> None:
    (tmp_path / "bad.tum").write_text(text)
    with pytest.raises(InputError) as caught:
        read_tum(tmp_path / "bad.tum", "a")
    assert f"bad.tum, line {line}:" in str(caught.value)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_of_repeated_stamps_the_first_counts_and_it_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "a.tum").write_text(GOOD + "2.0 5 0 0 0 0 0 1\n2.000 6 0 0 0 0 0 1\n2.5 7 0 0 0 0 0 1\n")
    assert read_tum(tmp_path / "a.tum", "a").positions[:, 0].tolist() == [0, 5, 7]
    assert "1 lines repeat a stamp" in caplog.text


@pytest.mark.parametrize("stamp", ["1.31704e+09", "1317040000", "1.317042e+09"])
def test_stamps_that_lost_their_digits_are_named(tmp_path: Path, stamp: str) -> None:
    (tmp_path / "a.tum").write_text("".join(f"{stamp} {x} 0 0 0 0 0 1\n" for x in range(9)))
    with pytest.raises(InputError, match=r"a\.tum: the stamp .* stands on 9 lines: .* digits only; .*nine decimals"):
        read_tum(tmp_path / "a.tum", "a")


@pytest.mark.parametrize(
    "text",
    [
        "1.5,1,2,3,0,0,0,1\n2.5,1,2,4,0,0,0,1\n",
        "1.5, 1, 2, 3, 0, 0, 0, 1\n2.5, 1, 2, 4, 0, 0, 0, 1\n",
        "1,5;1,0;2;3;0;0;0;1\n2,5;1;2;4,0;0;0;0;1\n",
        "1,5 1,0 2 3 0 0 0 1\n2,5 1,0 2 4 0 0 0 1\n",
        "timestamp,tx,ty,tz,qx,qy,qz,qw\n1.5,1,2,3,0,0,0,1\n2.5,1,2,4,0,0,0,1\n",
        "#timestamp x y z\nstamp x y z qx qy qz qw\n1.5\t1 2 3 0 0 0 1\r\n2.5 1 2 4 0 0 0 1",
        "\ufeff1.5 1 2 3 0 0 0 1\n2.5 1 2 4 0 0 0 1\n",
    ],
)
def test_separators_decimal_commas_and_names_of_columns(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.tum").write_text(text, encoding="utf-8")
    read = read_tum(tmp_path / "a.tum", "a")
    assert read.stamps_ns.tolist() == [1_500_000_000, 2_500_000_000]
    np.testing.assert_allclose(read.positions, [[1, 2, 3], [1, 2, 4]])


@pytest.mark.parametrize("content", [b"", b"# only a comment\n", b"\xff\xfe\x00\x80"])
def test_a_file_without_poses_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "none.tum").write_bytes(content)
    with pytest.raises(InputError, match=r"none\.tum"):
        read_tum(tmp_path / "none.tum", "a")


def test_missing_file_and_unwritable_place_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.tum"):
        read_tum(tmp_path / "gone.tum", "a")
    with pytest.raises(OutputError, match="nowhere"):
        write_tum(tmp_path / "nowhere" / "a.tum", random_trajectory(2))


def test_more_lines_than_numpy_reads_at_once_come_back(tmp_path: Path) -> None:
    trajectory = random_trajectory(60_000, start_ns=0)
    write_tum(tmp_path / "long.tum", trajectory)
    read = read_tum(tmp_path / "long.tum", "a")
    np.testing.assert_array_equal(read.stamps_ns, trajectory.stamps_ns)


@pytest.mark.parametrize(
    "names",
    [
        "timestamp,x,y,z,qw,qx,qy,qz",
        "# time tx ty tz q_w q_x q_y q_z",
        '"%time";"p.x";"p.y";"p.z";"orientation.w";"orientation.x";"orientation.y";"orientation.z"',
    ],
)
def test_names_tell_the_order_of_the_pose(tmp_path: Path, names: str) -> None:
    separator = next((mark for mark in ",;" if mark in names), " ")
    rows = [["1.5", "3", "2", "1", "0.6", "0", "0", "0.8"], ["2.5", "4", "2", "1", "1", "0", "0", "0"]]
    (tmp_path / "a.tum").write_text("\n".join([names, *(separator.join(row) for row in rows)]))
    trajectory = read_tum(tmp_path / "a.tum", "alpha")
    np.testing.assert_allclose(trajectory.positions, [[3, 2, 1], [4, 2, 1]])
    np.testing.assert_allclose(trajectory.poses[0, :2, 0], [0.6**2 - 0.8**2, 2 * 0.6 * 0.8], atol=1e-12)
    np.testing.assert_allclose(trajectory.poses[1, :3, :3], np.eye(3), atol=1e-12)


NAMES = "timestamp tx ty tz qx qy qz qw"
ROWS = ["1700000000.5 1 2 3 0 0 0 1", "1700000000.75 4 5 6 0 0 0 1", "1700000001.25 7 8 9 0 0 0 1"]
SEPARATE = [row.split(" ", 1) for row in ROWS]
VARIANTS = {
    "more columns": "\n".join(row + " 0.1 0.2" for row in ROWS),
    "more named columns": NAMES.replace(" ", ",") + ",vx,vy\n" + "\n".join(r.replace(" ", ",") + ",9,9" for r in ROWS),
    "a name first": "name," + NAMES.replace(" ", ",") + "\n" + "\n".join("a," + r.replace(" ", ",") for r in ROWS),
    "an index first": "," + NAMES.replace(" ", ",") + "\n" + "\n".join("0," + r.replace(" ", ",") for r in ROWS),
    "stamp last": "x,y,z,qx,qy,qz,qw,time\n" + "\n".join(f"{p},{t}".replace(" ", ",") for t, p in SEPARATE),
    "remarks of percent": "% recorded\n" + "\n".join(ROWS),
    "words above": "path of robot a\n\n" + "\n".join(ROWS),
    "remarks behind": "\n".join(row + " # keyframe" for row in ROWS),
    "milliseconds": "\n".join(f"{float(t) * 1e3:.0f} {p}" for t, p in SEPARATE),
    "named nanoseconds": NAMES + "\n" + "\n".join(f"{round(Decimal(t) * 10**9)} {p}" for t, p in SEPARATE),
    "dates": "\n".join(f"2023-11-14T22:13:{float(t) - 1_699_999_980:05.2f}Z {p}" for t, p in SEPARATE),
    "every row twice": "\n".join(row for row in ROWS for _ in range(2)),
    "echo of odometry": (
        "%time,field.header.seq,field.header.frame_id,field.pose.pose.position.x,field.pose.pose.position.y,"
        "field.pose.pose.position.z,field.pose.pose.orientation.x,field.pose.pose.orientation.y,"
        "field.pose.pose.orientation.z,field.pose.pose.orientation.w\n"
    ) + "\n".join(f"{round(Decimal(t) * 10**9)},7,odom,{p.replace(' ', ',')}" for t, p in SEPARATE),
}  # fmt: skip


@pytest.mark.parametrize("variant", VARIANTS)
def test_variants_of_the_same_poses(tmp_path: Path, variant: str) -> None:
    (tmp_path / "a.tum").write_text(VARIANTS[variant] + "\n")
    read = read_tum(tmp_path / "a.tum", "a")
    assert read.stamps_ns.tolist() == [1_700_000_000_500_000_000, 1_700_000_000_750_000_000, 1_700_000_001_250_000_000]
    np.testing.assert_allclose(read.positions, np.arange(1, 10).reshape(3, 3))


def test_encodings_of_spreadsheets(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_bytes("\r\n".join(ROWS).encode("utf-16"))
    assert len(read_tum(tmp_path / "a.tum", "a")) == 3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("".join(f"{1_700_000_000 + n // 5} {n} 1 1 0 0 0 1\n" for n in range(20)), "whole seconds stand on several"),
        ("1700000000500000000 1 2 3 1 0 0 0\n1700000000600000000 1 2 3 1 0 0 0\n", "quaternions begin with w; name"),
        ("1.5 0 0 9.8 0 0 0 25\n2.5 0 0 9.8 0 0 0 25\n", r"should be quaternions .* \(typically 25\): it holds no"),
    ],
)
def test_numbers_that_are_no_poses_are_refused(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(InputError, match=says):
        read_tum(tmp_path / "a.tum", "a")


NAMES = "# stamp [ns] x y z qw qx qy qz\n"


@pytest.mark.parametrize(
    ("first", "step", "names", "expected_s"),
    [
        (1_000_000_000_000, 200_000_000, NAMES, 0.2),  # 1000 s in ns: in ms a date of 2001
        (1_000_000_000_000, 50_000_000, NAMES, 0.05),
        (1_000_000_000_000, 10_000_000, NAMES, 0.01),  # in ms a pose every three hours
        (12_500_000_000, 100_000_000, NAMES, 0.1),
        (0, 100, "", 0.1),  # ms
        (0, 1, "", 1.0),
        (0, 50_000, "", 50e-3),  # us
        (0, 5, "", 5.0),
        (1_700_000_000, 120, "", 120.0),  # a date: keyframes far apart
    ],
)
def test_stamps_since_a_start_up_in_other_units_are_told_by_their_steps(
    tmp_path: Path, first: int, step: int, names: str, expected_s: float
) -> None:
    path = tmp_path / "a.tum"
    pose = "0 0 1 0 0 0" if names else "0 0 0 0 0 1"
    path.write_text(names + "".join(f"{first + n * step} {n} {pose}\n" for n in range(5)))
    read = read_tum(path, "alpha")
    assert np.diff(read.stamps_ns) == pytest.approx(1e9 * expected_s)
    assert read.poses[:, :3, :3] == pytest.approx(np.broadcast_to(np.eye(3), (5, 3, 3)))


def test_nanoseconds_without_names_are_refused_since_a_start_up_too(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text("".join(f"{10**12 + n * 10**8} {n} 0 0 0 0 0 1\n" for n in range(5)))
    with pytest.raises(InputError, match="its stamps are nanoseconds, as EuRoC's, whose quaternions begin with w"):
        read_tum(path, "alpha")


@pytest.mark.parametrize(
    ("name", "stamps", "expected_ns"),
    [
        ("stamp[ns]", [1_000_000_000_000, 1_000_000_020_000], [1_000_000_000_000, 1_000_000_020_000]),  # steps of 20 us
        ("time_us", [5_000_000, 5_100_000], [5_000_000_000, 5_100_000_000]),
        ("time_ms", [1500.5, 1600.5], [1_500_500_000, 1_600_500_000]),
        ("sec", [1500.5, 1600.5], [1_500_500_000_000, 1_600_500_000_000]),
    ],
)
@pytest.mark.parametrize("separator", [" ", ","])
def test_a_unit_in_the_line_of_names_goes_before_what_the_stamps_look_like(
    tmp_path: Path, name: str, stamps: list[float], expected_ns: list[int], separator: str
) -> None:
    rows = [f"{name} x y z qx qy qz qw", *(f"{at} 1 2 3 0 0 0 1" for at in stamps)]
    (tmp_path / "a.csv").write_text("\n".join(rows).replace(" ", separator) + "\n")
    assert read_tum(tmp_path / "a.csv", "a").stamps_ns.tolist() == expected_ns
