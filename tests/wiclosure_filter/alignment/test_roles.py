"""Which robot is named first changes nothing of an alignment but the direction in which it is stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.types import FrameAlignment, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.alignment.roles import as_named, with_reference_first
from wiclosure.wiclosure_filter.config import AlignmentSettings, FilterSettings
from wiclosure.wiclosure_filter.drift.calibration import CLOCK
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

from .test_align import KINDS, Scene, make_scene

SETTINGS = AlignmentSettings()


def links_of(scene: Scene, *order: str) -> Links:
    team = {robot: scene.trajectories[robot] for robot in order}
    (links,) = TeamLinks.of(team, scene.wireless, GatheringLimits.of(SETTINGS)).by_pair.values()
    return links


def drifting(scene: Scene, seed: int) -> Scene:
    """Odometry that errs at each step."""
    rng = np.random.default_rng(seed)

    def drifted(path: Trajectory) -> Trajectory:
        steps = se3.between(path.poses[:-1], path.poses[1:])
        steps = steps @ se3.exp(rng.normal(0, [0, 0, 0.01, 0.05, 0.05, 0], (len(steps), 6)))
        poses = [path.poses[0]]
        for step in steps:
            poses.append(poses[-1] @ step)
        return replace(path, poses=np.array(poses))

    return replace(scene, trajectories={name: drifted(path) for name, path in scene.trajectories.items()})


def shifted(scene: Scene, seconds: float) -> Scene:
    """The clock of robot b is ahead."""
    late = scene.trajectories["b"]
    late = replace(late, stamps_ns=late.stamps_ns + round(seconds * 1e9))
    return replace(scene, trajectories={**scene.trajectories, "b": late})


def assert_same(ab: FrameAlignment, ba: FrameAlignment) -> None:
    assert (ba.ambiguous, ba.reason, ba.suspected_fault) == (ab.ambiguous, ab.reason, ab.suspected_fault)
    assert (ba.strain, ba.strain_probability) == pytest.approx((ab.strain, ab.strain_probability))
    assert ba.bent_ns == ab.bent_ns
    assert len(ba.likely_alternatives) == len(ab.likely_alternatives)
    if ab.best is None or ba.best is None:
        assert ab.best is ba.best
        return
    np.testing.assert_allclose(ba.best.T_a_b @ ab.best.T_a_b, np.eye(4), atol=1e-9)
    assert ab.covariance is not None
    np.testing.assert_allclose(
        ba.covariance, se3.inverse_covariance(ab.best.T_a_b, ab.covariance), rtol=1e-6, atol=1e-9
    )
    assert ba.best.paths_kept == ab.best.paths_kept


@settings(deadline=None, max_examples=12)
@example("one-way", 286, 12, 0.0)
@given(st.sampled_from(KINDS), st.integers(0, 10**6), st.integers(3, 14), st.sampled_from([0.0, 1.5]))
def test_the_order_of_the_robots_changes_no_verdict(kind: str, seed: int, heard: int, clock_s: float) -> None:
    scene = make_scene(kind, seed=seed, heard=heard, absent=0.2, gross=0.05)
    scene = shifted(drifting(scene, seed), clock_s)
    orders = ("a", "b"), ("b", "a")
    assert_same(*(align(links_of(scene, *order), scene.trajectories, SETTINGS) for order in orders))


@settings(deadline=None, max_examples=3)
@given(st.sampled_from(KINDS), st.integers(0, 10**6))
def test_names_that_change_places_change_no_verdict_of_the_filter(kind: str, seed: int) -> None:
    scene = drifting(make_scene(kind, seed=seed), seed)
    other = {"a": "b", "b": "a"}
    named = {other[name]: replace(path, robot=other[name]) for name, path in scene.trajectories.items()}
    measurements = tuple(
        replace(m, receiver=other[m.receiver], transmitter=other[m.transmitter]) for m in scene.wireless.measurements
    )
    headings = tuple(replace(h, robot=other[h.robot]) for h in scene.wireless.headings)
    found = [
        WiClosureFilter(FilterSettings()).candidates(trajectories, log)
        for trajectories, log in (
            (scene.trajectories, scene.wireless),
            (dict(reversed(scene.trajectories.items())), scene.wireless),
            (named, WirelessLog(measurements, headings)),
        )
    ]
    assert len({one.alignments[0].ambiguous for one in found}) == 1
    np.testing.assert_allclose([one.pairs_kept for one in found], found[0].pairs_kept, rtol=0.01, atol=2)


def test_links_exchanged_twice_are_the_same() -> None:
    links = links_of(make_scene("reciprocal", seed=3), "a", "b")
    back = links.exchanged().exchanged()
    for name in vars(links):
        np.testing.assert_array_equal(getattr(back, name), getattr(links, name))


def test_links_exchanged_are_those_of_the_other_order() -> None:
    scene = make_scene("heading", seed=4)
    here, there = links_of(scene, "a", "b").exchanged(), links_of(scene, "b", "a")
    for name in vars(here):
        if name == "yaw":
            np.testing.assert_allclose(here.yaw, there.yaw)
        else:
            np.testing.assert_array_equal(getattr(here, name), getattr(there, name))


def still(scene: Scene, robot: str) -> Scene:
    """One robot moves a tenth as far."""
    poses = scene.trajectories[robot].poses.copy()
    poses[:, :3, 3] *= 0.1
    moved = replace(scene.trajectories[robot], poses=poses)
    return replace(scene, trajectories={**scene.trajectories, robot: moved})


@pytest.mark.parametrize("order", [("a", "b"), ("b", "a")])
@pytest.mark.parametrize(
    ("kind", "robot", "reference"),
    [("one-way", "a", "a"), ("one-way", "b", "a"), ("reciprocal", "a", "a"), ("reciprocal", "b", "b")],
)
def test_the_reference_received_more_or_moved_less(
    kind: str, robot: str, reference: str, order: tuple[str, str]
) -> None:
    scene = still(make_scene(kind, seed=2), robot)  # where one robot receives alone, it is a
    assert with_reference_first(links_of(scene, *order)).robot_a == reference


@pytest.mark.parametrize("order", [("a", "b"), ("b", "a")])
def test_of_robots_that_moved_as_far_the_one_that_received_first_is_the_reference(order: tuple[str, str]) -> None:
    scene = make_scene("reciprocal", seed=2, heard=1)
    assert with_reference_first(links_of(scene, *order)).robot_a == scene.wireless.measurements[0].receiver


def test_constant_errors_are_restated_for_the_robots_as_they_are_named() -> None:
    scene = shifted(make_scene("reciprocal", seed=7, noise=0.3), 0.5)
    ab, ba = (align(links_of(scene, *order), scene.trajectories, SETTINGS) for order in (("a", "b"), ("b", "a")))
    assert ab.calibration[CLOCK].name == "clock of b ahead of that of a"
    assert ba.calibration[CLOCK].name == "clock of a ahead of that of b"
    assert ba.calibration[CLOCK].value == pytest.approx(-ab.calibration[CLOCK].value)
    others = [{one.name: one.value for one in found.calibration if "clock" not in one.name} for found in (ab, ba)]
    assert others[0] == others[1]
    assert ab.calibration_covariance is not None
    assert ba.calibration_covariance is not None
    sigma = [np.sqrt(np.diag(found.calibration_covariance)) for found in (ab, ba)]  # type: ignore[arg-type]
    for found, own in zip((ab, ba), sigma, strict=True):
        np.testing.assert_allclose([one.sigma for one in found.calibration], own)


def test_times_are_restated_by_the_clock_of_the_robot_that_is_named_first() -> None:
    scene = make_scene("one-way", seed=2)
    links = links_of(scene, "a", "b")
    links = replace(links, stamp_b_ns=links.stamp_a_ns + 3_000_000_000)
    found = align(links.exchanged(), scene.trajectories, SETTINGS)
    bent = replace(found, bent_ns=(int(links.stamp_b_ns[2]), int(links.stamp_b_ns[4])))
    assert as_named(bent, links).bent_ns == (int(links.stamp_a_ns[2]), int(links.stamp_a_ns[4]))
