"""Tables of inertial measurements and positions."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.navigation.tables import read_gnss_table, read_imu_table

ACCELERATION, RATE = [0.1, -0.2, 9.8], [0.01, 0.02, -0.03]


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("", "{s} 0.1 -0.2 9.8 0.01 0.02 -0.03"),
        ("# stamp ax ay az gx gy gz", "{s} 0.1 -0.2 9.8 0.01 0.02 -0.03"),
        ("stamp,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z", "{s},0.1,-0.2,9.8,0.01,0.02,-0.03"),
        (
            "time,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z,"
            "angular_velocity.x,angular_velocity.y,angular_velocity.z",
            "{s},0.1,-0.2,9.8,0.01,0.02,-0.03",
        ),
        (
            "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],"
            "a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]",
            "{ns},0.01,0.02,-0.03,0.1,-0.2,9.8",
        ),
        ("gz gy gx t az ay ax", "-0.03 0.02 0.01 {s} 9.8 -0.2 0.1"),
    ],
)
def test_columns_in_any_order(tmp_path, head, row):
    stamps = [1_700_000_000_000_000_000 + n * 10_000_000 for n in range(4)]
    lines = [row.format(s=f"{ns // 10**9}.{ns % 10**9:09d}", ns=ns) for ns in stamps]
    path = tmp_path / "imu.csv"
    path.write_text("\n".join([head, *lines]).lstrip() + "\n")
    log = read_imu_table(path)
    assert log.stamps_ns.tolist() == stamps
    np.testing.assert_array_equal(log.acceleration, [ACCELERATION] * 4)
    np.testing.assert_array_equal(log.turning_rate, [RATE] * 4)


def test_bad_rows_are_left_out_and_missing_columns_named(tmp_path, caplog):
    path = tmp_path / "imu.txt"
    path.write_text("1.0 0 0 9.8 0 0 0\n1.1 nan 0 9.8 0 0 0\n1.2 x 0 9.8 0 0 0\n1.0 0 0 9.8 0 0 0\n1.3 0 0 9.8 0 0 0\n")
    assert read_imu_table(path).stamps_ns.tolist() == [10**9, 1_300_000_000]
    assert "3 of 5 rows" in caplog.text
    path.write_text("stamp,ax,ay,az,gx,gy\n1,0,0,9.8,0,0\n")
    with pytest.raises(InputError, match="no column of turning rate z; its columns: stamp, ax"):
        read_imu_table(path)
    path.write_text("1.0 0 0 9.8\n2.0 0 0 9.8\n")
    with pytest.raises(InputError, match="has 4 columns; expected 7"):
        read_imu_table(path)


def test_positions_with_sigmas_and_without(tmp_path):
    path = tmp_path / "gnss.csv"
    path.write_text("stamp,latitude,longitude,altitude\n10.0,49.0,8.4,110\n11.0,49.1,8.5,111\n")
    log = read_gnss_table(path)
    np.testing.assert_array_equal(log.geodetic, [[49.0, 8.4, 110], [49.1, 8.5, 111]])
    path.write_text("10.0 49.0 8.4 110 0.5 0.6 1.0\n11.0 49.1 8.5 111 0.5 0.6 1.0\n")
    np.testing.assert_array_equal(read_gnss_table(path).sigma_enu, [[0.5, 0.6, 1.0]] * 2)


@pytest.mark.parametrize(
    ("head", "stamp"),
    [
        ("time_us,ax,ay,az,gx,gy,gz", "2500000"),
        ("timestamp (ms),ax,ay,az,gx,gy,gz", "2500"),
        ("t,ax,ay,az,gx,gy,gz\n[ms],-,-,-,-,-,-", "2500"),
    ],
)
def test_a_unit_in_the_line_of_names_or_below_it_counts(tmp_path, head, stamp):
    path = tmp_path / "imu.csv"
    path.write_text(f"{head}\n{stamp},0,0,9.8,0,0,0\n")
    assert read_imu_table(path).stamps_ns.tolist() == [2_500_000_000]


def test_seconds_and_nanoseconds_in_two_columns_are_refused(tmp_path):
    path = tmp_path / "imu.csv"
    path.write_text("stamp.secs,stamp.nsecs,ax,ay,az,gx,gy,gz\n1,500000000,0,0,9.8,0,0,0\n")
    with pytest.raises(InputError, match="write them as one number of seconds"):
        read_imu_table(path)
