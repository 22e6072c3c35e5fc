"""OXTS files of KITTI's raw drives."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.navigation.oxts import oxts_folder, read_oxts_gnss, read_oxts_imu


@pytest.fixture
def drive(tmp_path):
    """`2011_09_26/2011_09_26_drive_0005_sync` with three instants."""
    folder = tmp_path / "2011_09_26" / "2011_09_26_drive_0005_sync"
    (folder / "oxts" / "data").mkdir(parents=True)
    for n in range(3):
        numbers = np.arange(30.0)
        numbers[:3], numbers[11:14], numbers[17:20], numbers[23] = (49.0 + n, 8.4, 110), (n, 0, 9.8), (0, 0, 0.1), 0.4
        (folder / "oxts" / "data" / f"{n:010d}.txt").write_text(" ".join(map(str, numbers)))
    times = "".join(f"2011-09-26 13:02:2{n}.100000000\n" for n in range(3))
    (folder / "oxts" / "timestamps.txt").write_text(times)
    return folder


def test_columns_as_kitti_names_them(drive):
    folder = oxts_folder(drive)
    assert folder == drive / "oxts"
    assert oxts_folder(folder) == folder
    reading = read_oxts_imu(folder)
    np.testing.assert_array_equal(reading.log.acceleration, [[n, 0, 9.8] for n in range(3)])
    np.testing.assert_array_equal(reading.log.turning_rate, [[0, 0, 0.1]] * 3)
    assert np.diff(reading.log.stamps_ns).tolist() == [10**9] * 2
    assert reading.T_lidar_imu is None
    fixes = read_oxts_gnss(folder)
    np.testing.assert_array_equal(fixes.geodetic[:, 0], [49, 50, 51])
    np.testing.assert_allclose(fixes.sigma_enu, [[0.4, 0.4, 0.8]] * 3)


def test_the_calibration_beside_the_drive_is_the_mounting(drive):
    text = "calib_time: 25-May-2012\nR: 0 -1 0 1 0 0 0 0 1\nT: -0.8 0.3 -0.8\n"
    (drive.parent / "calib_imu_to_velo.txt").write_text(text)
    T = read_oxts_imu(drive / "oxts").T_lidar_imu
    np.testing.assert_allclose(T, [[0, -1, 0, -0.8], [1, 0, 0, 0.3], [0, 0, 1, -0.8], [0, 0, 0, 1]], atol=1e-12)


def test_what_is_missing_is_named(drive, tmp_path):
    assert oxts_folder(tmp_path) is None
    (drive / "oxts" / "data" / "0000000001.txt").unlink()
    with pytest.raises(InputError, match="2 files and 3 times"):
        read_oxts_imu(drive / "oxts")
