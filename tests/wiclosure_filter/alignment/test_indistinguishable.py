"""Blunders that would fit as well, by how the robots moved."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, AoaPath, FloatArray, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.alignment.indistinguishable import Blunders
from wiclosure.wiclosure_filter.config import AlignmentSettings, AmbiguitySettings
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.likelihood.residuals import displacements_in_a, explained
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks

STEPS = 40
OFFSET = np.array([0.0, 8.0, 0.0])


def straight(turn_rad: float = 0.0) -> FloatArray:
    yaw = turn_rad * np.arange(STEPS)
    steps = np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw])
    return se3.from_yaw(yaw, np.cumsum(steps, axis=0))


def case(a: FloatArray, b: FloatArray) -> tuple[dict[str, Trajectory], WirelessLog]:
    """Both frames are the world's."""
    stamps_ns = np.arange(STEPS, dtype=np.int64) * 10**9
    rng = np.random.default_rng(1)
    seen = se3.between(a, b)[:, :3, 3]
    log = tuple(
        WirelessMeasurement(
            int(t), "a", "b", float(np.linalg.norm(p)), 0.3, (AoaPath(float(np.arctan2(p[1], p[0]) + e), 0.14),)
        )
        for t, p, e in zip(stamps_ns[::2], seen[::2], rng.normal(0, 0.05, STEPS // 2), strict=True)
    )
    return {"a": Trajectory("a", stamps_ns, a), "b": Trajectory("b", stamps_ns, b)}, WirelessLog(log)


def blunders(a: FloatArray, b: FloatArray, compass: float = np.nan) -> Blunders:
    """By alignments that are right; `compass` is the relative yaw that compasses tell."""
    trajectories, log = case(a, b)
    settings = AlignmentSettings()
    links = TeamLinks.of(trajectories, log, GatheringLimits.of(settings)).by_pair["a", "b"]
    problem = AlignmentProblem.of(links, trajectories, settings)
    mixture, (drift_m, _) = problem.anchored_at(len(links) // 2)
    state = problem.observations.state(np.eye(4))
    w = displacements_in_a(state[None], problem.observations)[1][0]
    none, prior = np.zeros(len(links)), Prior(compass, 0.07, 0.0, 1.0)
    return Blunders.of(w, none, links, problem.odometry, mixture, explained(state, mixture), 0.1 + 0 * drift_m, prior)


def row(found: Blunders, clause: str) -> int:
    return [reading.clause for reading in found.readings].index(clause)


def moved(poses: FloatArray, by: FloatArray) -> FloatArray:
    poses = poses.copy()
    poses[:, :3, 3] += by
    return poses


def test_in_parallel_every_blunder_fits_and_none_is_excluded() -> None:
    found = blunders(straight(), moved(straight(), OFFSET))
    np.testing.assert_allclose(found.chi2, found.chi2[0], atol=0.2)
    reversed_ = row(found, "azimuths were reversed")
    assert found.apart_m(0)[reversed_] == pytest.approx(2 * 8.0, abs=0.2)
    assert found.apart_m(0)[0] == 0.0
    places = found.likely(2.0, 20.0)
    mirrored, swapped = row(found, "azimuths were clockwise"), row(found, "the robots' names were swapped")
    assert {mirrored, reversed_, swapped} in map(set, places)  # b is on the other side of a
    assert "azimuths were reversed" in found.objection(places, 20.0)
    claimed = AlignmentHypothesis(np.eye(4), 0.0, ())
    T_reversed = found.hypothesis(reversed_, claimed).T_a_b
    np.testing.assert_allclose(T_reversed, se3.from_yaw(0.0, -2 * OFFSET), atol=0.3)


def test_where_both_turn_by_themselves_no_blunder_fits() -> None:
    found = blunders(straight(0.08), moved(straight(-0.11), OFFSET))
    assert found.chi2[0] < 1.0
    compass = row(found, "a compass was off")  # there is none
    assert found.apart_m(0)[compass] == 0.0
    assert (np.delete(found.chi2, [0, compass]) > 30.0).all()
    assert found.objection(found.likely(2.0, 20.0), 20.0) == ""


def test_compasses_speak_against_what_would_turn_the_frames() -> None:
    """With b that drives along while a stands, turned azimuths turn b's frame; nothing else tells."""
    standing, along_y = np.tile(np.eye(4), (STEPS, 1, 1)), moved(straight(), OFFSET)
    untold, told = (blunders(standing, along_y, compass) for compass in (np.nan, 0.0))
    turning, off = row(told, "azimuths were taken from the left axis"), row(told, "a compass was off")
    assert untold.odds[turning] == pytest.approx(0.02, rel=0.1)
    assert told.odds[turning] < 1e-6
    # A heading of 4 degrees that displacements confirm is 2 pi / (sqrt(2 pi) 0.07) times likelier than by chance.
    np.testing.assert_allclose(told.odds[off], 0.02 * np.sqrt(2 * np.pi) * 0.07 / (2 * np.pi), rtol=0.4)
    assert blunders(standing, along_y, np.pi / 2).odds[off] > 1e6


def test_a_robot_that_drives_straight_may_be_an_image_in_a_wall() -> None:
    assert blunders(straight(0.08), moved(straight(), OFFSET)).image_odds == pytest.approx(0.03, rel=0.2)
    assert blunders(straight(), moved(straight(0.08), OFFSET)).image_odds < 1e-6


def test_an_image_is_far_likelier_where_measurements_move_as_one() -> None:
    """What a hears of b is b's image behind a wall, and b turns: a rigid transform of its odometry hardly fits."""
    wall = np.diag([1.0, -1.0, 1.0, 1.0])
    b = moved(straight(0.004), OFFSET)
    trajectories, log = case(straight(), wall @ b @ wall)
    settings = AlignmentSettings()
    odometry = {**trajectories, "b": Trajectory("b", trajectories["b"].stamps_ns, b)}
    links = TeamLinks.of(odometry, log, GatheringLimits.of(settings)).by_pair["a", "b"]
    aligned = align(links, odometry, settings)
    assert aligned.ambiguous
    assert not aligned.likely_alternatives
    assert "all of it was heard by a reflection (anywhere nearer)" in aligned.reason


def test_a_blunder_that_changes_nothing_is_no_objection() -> None:
    """b ahead of a on one line: mirrored, it is where it was."""
    ahead = moved(straight(), np.array([20.0, 0.0, 0.0]))
    found = blunders(straight(), ahead)
    mirrored = row(found, "azimuths were clockwise")
    assert found.apart_m(0)[mirrored] == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize(("turn_a", "turn_b", "certain"), [(0.0, 0.0, False), (0.08, -0.11, True)])
def test_an_alignment_is_not_certain_where_blunders_fit(turn_a: float, turn_b: float, certain: bool) -> None:
    trajectories, log = case(straight(turn_a), moved(straight(turn_b), OFFSET))
    settings = AlignmentSettings()
    links = TeamLinks.of(trajectories, log, GatheringLimits.of(settings)).by_pair["a", "b"]
    assert align(links, trajectories, settings).ambiguous is not certain
    unweighed = settings.model_copy(update={"guard": AmbiguitySettings(weigh_blunders=False)})
    assert not align(links, trajectories, unweighed).ambiguous
