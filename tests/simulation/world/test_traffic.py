"""Cars and people that move in a simulated world: where they are when beams pass over them, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.simulation.scenario import Scenario, SimulatedScans
from wiclosure.simulation.scenarios.registry import ScenarioSettings, make_scenario
from wiclosure.simulation.world.mesh import box
from wiclosure.simulation.world.motion import START_NS, GroundPath
from wiclosure.simulation.world.traffic import Mover, Traffic, TrafficSettings

BUSY = {"cars": 6, "walkers": 6}


@pytest.fixture(scope="module")
def busy() -> Scenario:
    return make_scenario("city", ScenarioSettings.model_validate({"robots": 1, "traffic": BUSY}))


def in_world(source: SimulatedScans, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a scan in the world, when each was measured, and which move."""
    scan, moving = source.labelled(index)
    assert scan.times is not None
    stamps_ns = scan.stamp_ns + np.rint(scan.times * 1e9).astype(np.int64)
    world = se3.transform(source.motion.T_world_body(stamps_ns)[:, None], scan.points[:, None])[:, 0]
    return world, stamps_ns, moving


def test_moving_points_lie_on_movers_as_they_stand_when_the_beam_passes(busy: Scenario) -> None:
    source, seen = busy.scan_source("alpha"), 0
    assert source.traffic is not None
    for index in range(0, len(source), 60):
        world, stamps_ns, moving = in_world(source, index)
        some = np.flatnonzero(moving)[::5]
        off = np.full(len(some), np.inf)
        for n, (point, stamp_ns) in enumerate(zip(world[some], stamps_ns[some], strict=True)):
            for mover in source.traffic.movers:
                if (T := mover.at(int(stamp_ns))) is not None:
                    own = se3.transform(se3.inverse(T), point[None])[0]
                    off[n] = min(off[n], np.max(np.abs(own[:2]) - mover.half_m))
        seen += len(off)
        assert (off < 0.25).all()  # range noise, and a long car's ends are passed a little later than its middle
    assert seen > 100


def test_without_it_scans_are_as_before_and_with_it_only_what_it_hides_is_missing(busy: Scenario) -> None:
    plain = make_scenario("city", ScenarioSettings(robots=1)).scan_source("alpha")
    assert plain.traffic is None
    for index in (40, 130):
        before, moving = plain.labelled(index)
        assert not moving.any()
        scan, moving = busy.scan_source("alpha").labelled(index)
        old = {tuple(p) for p in before.points.tolist()}
        assert all(tuple(p) in old for p in scan.points[~moving].tolist())
        assert len(before.points) - (~moving).sum() <= 1.5 * moving.sum() + 200


def test_one_seed_makes_one_traffic_in_any_order_and_another_another(busy: Scenario) -> None:
    again = make_scenario("city", ScenarioSettings.model_validate({"robots": 1, "traffic": BUSY}))
    for index in (90, 10):
        one, other = (world.scan_source("alpha").scan(index) for world in (busy, again))
        np.testing.assert_array_equal(one.points, other.points)
    other = make_scenario("city", ScenarioSettings.model_validate({"robots": 1, "traffic": BUSY, "seed": 1}))
    assert busy.traffic is not None
    assert other.traffic is not None
    assert busy.traffic.movers[0].start_m != other.traffic.movers[0].start_m


def test_nothing_runs_through_what_stands_or_into_a_robot(busy: Scenario) -> None:
    assert busy.traffic is not None
    for mover in busy.traffic.movers:
        for second in range(0, 60, 7):
            if (T := mover.at(START_NS + second * 10**9)) is not None:
                assert busy.scene.clearance(T[None, :3, 3] + [0, 0, 0.8])[0] > 0.2
    path = GroundPath.through(np.array([[-50.0, 0.0], [50.0, 0.0]]), 1.0)
    free = np.ones(len(path.s_m), bool)
    mover = Mover(box(4.0, 1.8, 1.5), np.array([2.0, 0.9]), path, free, busy.scene.ground, 10.0, 40.0)
    T = mover.at(START_NS + 10**9)
    assert T is not None
    np.testing.assert_allclose(T[:2, 3], [0.0, 0.0], atol=0.05)
    assert mover.covers(T, np.array([[1.0, 1.0, 1.7]]))
    assert not mover.covers(T, np.array([[1.0, 2.8, 1.7], [9.0, 0.0, 1.7]]))
    assert replace(mover, free=~free).at(START_NS) is None


def test_robots_that_hardly_move_have_no_street() -> None:
    settings = TrafficSettings(cars=5)
    scenario = make_scenario("static-mirror")
    assert Traffic.along(scenario.robots, scenario.scene, settings, 0).movers == ()
