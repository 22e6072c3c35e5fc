from __future__ import annotations

import numpy as np
import pytest

from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.odometry.sweep import sweep_stamps_ns, sweep_times, within_range
from wiclosure.types import Scan

STAMP_NS = 1_700_000_000_123_456_789
POINTS = np.ones((3, 3))


def test_the_instants_of_the_first_and_of_the_last_point_in_whatever_order_they_come() -> None:
    scan = Scan(STAMP_NS, POINTS, np.array([0.02, -0.05, 0.04]))
    assert (sweep_stamps_ns(scan, OdometrySettings()) - STAMP_NS).tolist() == [-50_000_000, 40_000_000]
    np.testing.assert_array_equal(sweep_times(scan, OdometrySettings()), [0.02, -0.05, 0.04])


@pytest.mark.parametrize(
    ("scan", "settings"),
    [
        (Scan(STAMP_NS, POINTS), OdometrySettings()),
        (Scan(STAMP_NS, POINTS, np.full(3, 0.05)), OdometrySettings()),
        (Scan(STAMP_NS, POINTS, np.array([0.0, 0.05, 0.1])), OdometrySettings(deskew=False)),
        (Scan(STAMP_NS, np.zeros((0, 3)), np.zeros(0)), OdometrySettings()),
    ],
    ids=["no times", "times all alike", "switched off", "no points"],
)
def test_where_there_is_nothing_to_deskew_by_the_sweep_is_its_stamp(scan: Scan, settings: OdometrySettings) -> None:
    assert len(sweep_times(scan, settings)) == 0
    assert sweep_stamps_ns(scan, settings).tolist() == [STAMP_NS, STAMP_NS]


def test_ranges_are_open_intervals() -> None:
    settings = OdometrySettings(min_range_m=2.0, max_range_m=10.0)
    points = np.array([[2.0, 0, 0], [0, 2.1, 0], [0, 0, -9.9], [6.0, 8.0, 0], [6.0, 7.9, 0], [0, 0, 0]])
    assert within_range(points, settings).tolist() == [False, True, True, False, True, False]
