"""The demo's world."""

from __future__ import annotations

import numpy as np

from wiclosure.simulation import make_scenario


def test_demo_site_is_short_and_its_robots_meet() -> None:
    demo_site = make_scenario("demo-site")
    alpha, beta = (demo_site.ground_truth(robot) for robot in ("alpha", "beta"))
    assert all(len(demo_site.scan_source(robot)) < 220 for robot in demo_site.robots)
    assert alpha.distance[-1] > 90
    assert beta.distance[-1] > 90
    apart = np.linalg.norm(alpha.positions[:, None] - beta.positions[None], axis=2)
    middle = alpha.positions[:, 1] > -5
    assert apart[middle].min() < 9
    assert apart[~middle].min() < 2
