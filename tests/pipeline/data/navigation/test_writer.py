"""Tables come back as they were written."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import OutputError
from wiclosure.pipeline.data.navigation.writer import write_gnss_table, write_imu_table
from wiclosure.pipeline.sources.navigation.tables import read_gnss_table, read_imu_table
from wiclosure.types import GnssLog, ImuLog

STAMPS_NS = 1_700_000_000_123_456_789 + np.arange(5, dtype=np.int64) * 10_000_001
RNG = np.random.default_rng(0)


def test_there_and_back(tmp_path):
    imu = ImuLog(STAMPS_NS, RNG.normal(size=(5, 3)), RNG.normal(size=(5, 3)))
    write_imu_table(tmp_path / "imu.csv", imu)
    back = read_imu_table(tmp_path / "imu.csv")
    for name in ("stamps_ns", "acceleration", "turning_rate"):
        np.testing.assert_array_equal(getattr(back, name), getattr(imu, name))
    gnss = GnssLog(STAMPS_NS, RNG.normal(size=(5, 3)), np.full((5, 3), 0.7))
    write_gnss_table(tmp_path / "gnss.csv", gnss)
    back_fixes = read_gnss_table(tmp_path / "gnss.csv")
    for name in ("stamps_ns", "geodetic", "sigma_enu"):
        np.testing.assert_array_equal(getattr(back_fixes, name), getattr(gnss, name))


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(OutputError, match="cannot write"):
        write_imu_table(tmp_path / "no" / "imu.csv", ImuLog(STAMPS_NS, np.zeros((5, 3)), np.zeros((5, 3))))
