"""What can be asked of measurements as arrays."""

from __future__ import annotations

import numpy as np

from wiclosure.types import Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

STANDING = {name: Trajectory(name, np.array([0, 30]) * 10**9, np.tile(np.eye(4), (2, 1, 1))) for name in ("a", "b")}


def links_of(trajectories: dict[str, Trajectory], wireless: WirelessLog) -> Links:
    return TeamLinks.of(trajectories, wireless, GatheringLimits.of(AlignmentSettings())).by_pair["a", "b"]


def test_thinning_keeps_neighbours_together_over_all_the_time() -> None:
    log = WirelessLog(tuple(WirelessMeasurement(29_000_000 * k, "a", "b", 5.0, 0.5) for k in range(1000)))
    links = links_of(STANDING, log)
    thin = links.thinned(100)
    assert 90 <= len(thin) <= 100
    assert thin.measurement[[0, 1, 2, 3]].tolist() == [0, 1, 2, 3]
    assert thin.measurement[-1] == 999
    assert "of 1000 measurements" in thin.left_out[0]
    assert links.thinned(1000) is links
