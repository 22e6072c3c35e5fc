from __future__ import annotations

from itertools import permutations
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.formats.trajectories.pose_columns import POSE, line_of_names, pose_columns, stated_unit

PATH = Path("poses.txt")
SCALAR_FIRST = ("stamp", "x", "y", "z", "qw", "qx", "qy", "qz")


def test_the_line_of_names_may_be_a_comment_and_stand_below_others():
    names = "# stamp, tx, ty, tz, qx, qy, qz, qw"
    assert line_of_names(f"# written by a recorder\n{names}\n1 2 3 4 0 0 0 1\n") == names


@pytest.mark.parametrize("text", ["", "1 2 3 4 0 0 0 1\n", "# stamp x y z\n", "a b c d e f g 8\n"])
def test_numbers_and_short_lines_are_no_names(text):
    assert line_of_names(text) == ""


@pytest.mark.parametrize(
    ("line", "order"),
    [
        ("stamp x y z qx qy qz qw", [1, 2, 3, 4, 5, 6, 7]),
        ("# timestamp tx ty tz qw qx qy qz", [1, 2, 3, 5, 6, 7, 4]),
        ("#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
         [1, 2, 3, 5, 6, 7, 4]),
        ("time;orientation.x;orientation.y;orientation.z;orientation.w;position.x;position.y;position.z",
         [5, 6, 7, 1, 2, 3, 4]),
        ('"sec","x","y","z","rot_x","rot_y","rot_z","rot_w"', [1, 2, 3, 4, 5, 6, 7]),
    ],
)  # fmt: skip
def test_columns_are_found_by_their_names(line, order):
    default = POSE if order != [1, 2, 3, 4, 5, 6, 7] else SCALAR_FIRST
    assert pose_columns(PATH, line, default) == [0, *order]


@given(row=st.sampled_from(list(permutations(("name", *POSE)))[::9973]))
def test_any_order_of_the_columns_is_undone(row):
    columns = pose_columns(PATH, " ".join(row), POSE)
    assert [row[column] for column in columns] == list(POSE)


@pytest.mark.parametrize("line", ["", "# one two three four five six seven eight", "# t x y z qx qy qz qz"])
def test_remarks_mean_the_order_of_the_format(line):
    assert pose_columns(PATH, line, SCALAR_FIRST) == [0, 1, 2, 3, 5, 6, 7, 4]


def test_names_without_a_pose_are_refused():
    with pytest.raises(InputError, match=r"of its columns \(time, ax, .*\) none is qx or qy or qz or qw"):
        pose_columns(PATH, "time,ax,ay,az,gx,gy,gz,temp", POSE)
    with pytest.raises(InputError, match="seconds and nanoseconds in two columns; write them as one number"):
        pose_columns(PATH, "sec,nsec,x,y,z,qx,qy,qz,qw", POSE)


@pytest.mark.parametrize(
    ("stamp", "unit"),
    [
        ("stamp", None), ("t", None), ("ts", None), ("ts_us", "us"), ("t_ms", "ms"),
        ("stamp[ns]", "ns"), ("stamp [ns]", "ns"), ("time_us", "us"), ("Time (ms)", "ms"),
        ("timestampNs", "ns"), ("sec", "s"), ("header.stamp.secs", "s"), ("nanoseconds", "ns"), ("time_status", None),
        ("header.stamp.nsec", "ns"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("separator", [" ", ",", ";"])
def test_the_name_of_the_stamps_may_state_their_unit(stamp, unit, separator):
    line = separator.join([stamp, "x [m]", "y [m]", "z [m]", "qx []", "qy []", "qz []", "qw []"])
    assert stated_unit(line) == unit
    assert pose_columns(PATH, line, SCALAR_FIRST) == list(range(8))
