"""What becomes of radio that was measured after the scans that are read."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.front_end_result import FrontEndCounts
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.stages.part_read import without_later_radio
from wiclosure.types import Heading, Trajectory, WirelessLog, WirelessMeasurement

S = 10**9


def front(robot: str, last_s: int, scans: int) -> FrontEndResult:
    stamps_ns = np.array([0, last_s * S])
    path = Trajectory(robot, stamps_ns, se3.from_rotation_translation(np.eye(3), np.zeros((2, 3))))
    return cast("FrontEndResult", SimpleNamespace(scans=path, counts=FrontEndCounts(scans)))


LOG = WirelessLog(
    (
        WirelessMeasurement(5 * S, "alpha", "beta", 4.0, 0.5),
        WirelessMeasurement(15 * S, "beta", "alpha", 4.0, 0.5, transmitter_stamp_ns=5 * S),
        WirelessMeasurement(15 * S, "alpha", "beta", 4.0, 0.5),
        WirelessMeasurement(25 * S, "beta", "gamma", 4.0, 0.5),
    ),
    (Heading(5 * S, "alpha", 0.0, 0.1), Heading(15 * S, "alpha", 0.0, 0.1)),
)
FRONTS = {"alpha": front("alpha", 10, 100), "beta": front("beta", 20, 100), "gamma": front("gamma", 30, 60)}


def test_later_radio_of_robots_that_are_read_in_part_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    kept = without_later_radio(Inputs((), LOG, limit=100), FRONTS).wireless
    assert kept.measurements == LOG.measurements[:2]
    assert kept.headings == LOG.headings[:1]
    assert "2 of 4 radio measurements are later than the 100 scans that are read of each robot" in caplog.text


def test_where_all_of_it_is_later_a_wrong_clock_would_not_show(caplog: pytest.LogCaptureFixture) -> None:
    assert (
        without_later_radio(Inputs((), WirelessLog(LOG.measurements[2:]), limit=60), FRONTS).wireless == WirelessLog()
    )
    assert "all 2 radio measurements are later than the 60 scans" in caplog.text


@pytest.mark.parametrize("limit", [None, 101])
def test_of_whole_recordings_all_of_it_counts(limit: int | None) -> None:
    assert without_later_radio(Inputs((), LOG, limit=limit), FRONTS).wireless == LOG
