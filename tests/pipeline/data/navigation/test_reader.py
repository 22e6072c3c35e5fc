"""Where a robot's inertial measurements and positions come from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure.errors import InputError
from wiclosure.pipeline.data.navigation.reader import read_gnss, read_imu
from wiclosure.pipeline.data.recording import RobotRecording

ROWS = "".join(f"{n / 100:.2f} 0 0 1.0 0 0 57.29577951308232\n" for n in range(300))


@pytest.fixture
def recording(tmp_path):
    (tmp_path / "imu.txt").write_text(ROWS)
    (tmp_path / "gnss.txt").write_text("0.0 49.0 8.4 110\n1.0 49.0 8.4 110\n")
    (tmp_path / "scans").mkdir()
    return RobotRecording(tmp_path / "scans", imu=tmp_path / "imu.txt", time_offset=5.0)


def test_a_table_in_other_units_and_another_clock(recording):
    chosen = replace(recording, imu_units=("g", "deg/s"), imu_time_offset=-0.5,
                     imu_pose=(0.1, 0.2, 0.3, *Rotation.from_euler("z", 90, degrees=True).as_quat()))  # fmt: skip
    imu, remarks = read_imu("alpha", chosen)
    assert imu is not None
    assert remarks == []
    assert imu.log.stamps_ns[0] == 4_500_000_000
    np.testing.assert_allclose(imu.log.acceleration[0], [0, 0, 9.80665])
    np.testing.assert_allclose(imu.log.turning_rate[0], [0, 0, 1.0])
    np.testing.assert_allclose(imu.T_lidar_imu[:3], [[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, 0.3]], atol=1e-12)


def test_nothing_named_and_nothing_there(recording):
    assert read_imu("alpha", replace(recording, imu=None)) == (None, [])
    assert read_gnss("alpha", recording) == (None, [])


def test_what_is_named_must_be_readable(recording, tmp_path):
    (tmp_path / "bad.txt").write_text("1 2 3\n")
    with pytest.raises(InputError, match=r"robot alpha: .*bad.txt has 3 columns"):
        read_imu("alpha", replace(recording, imu=tmp_path / "bad.txt"))
    with pytest.raises(InputError, match="is no bag, so it has no topic /imu"):
        read_imu("alpha", replace(recording, imu_topic="/imu"))
    with pytest.raises(InputError, match="neither a bag nor a folder of OXTS"):
        read_imu("alpha", replace(recording, imu=recording.scans))
    with pytest.raises(InputError, match=r"robot alpha: .* is no bag"):
        read_gnss("alpha", replace(recording, gnss_topic="/fix"))


def test_positions_of_a_table_with_their_antenna(recording, tmp_path):
    gnss, _ = read_gnss("alpha", replace(recording, gnss=tmp_path / "gnss.txt", gnss_antenna=(0.0, 0.1, 0.9)))
    assert gnss is not None
    assert gnss.log.stamps_ns.tolist() == [5 * 10**9, 6 * 10**9]
    assert gnss.antenna_lidar.tolist() == [0.0, 0.1, 0.9]
