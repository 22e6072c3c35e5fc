"""Halls that look the same turned by half a turn, with two robots put together rightly or not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.rivals.maps import RivalMap, rival_maps
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.registrations import RegistrationPool
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import Closure, Float32Array, FloatArray, KeyframeId, Stage, Trajectory, WirelessLog

HALF_LENGTH_M, HALF_WIDTH_M, REACH_M = 9.0, 6.5, 14.0
PILLARS_M = np.array([(-5.0, 2.0), (-1.5, -3.5)])


def upright(at: FloatArray) -> FloatArray:
    """Points `(N, 3)` over spots `(M, 2)` from floor to ceiling."""
    heights_m = np.arange(-1.0, 1.5, 0.12)
    return np.column_stack([np.repeat(at, len(heights_m), axis=0), np.tile(heights_m, len(at))])


def hall(symmetric: bool) -> FloatArray:
    """Walls and pillars; where it is not symmetric, one pillar has no counterpart but stands elsewhere."""
    x, y = np.arange(-HALF_LENGTH_M, HALF_LENGTH_M, 0.12), np.arange(-HALF_WIDTH_M, HALF_WIDTH_M, 0.12)
    walls = [np.column_stack([x, 0 * x + side * HALF_WIDTH_M]) for side in (-1, 1)]
    walls += [np.column_stack([0 * y + side * HALF_LENGTH_M, y]) for side in (-1, 1)]
    counterparts = -PILLARS_M if symmetric else np.array([(6.5, 4.0), (3.0, -1.0), (0.5, 4.5)])
    turn = np.arange(0, 2 * np.pi, 0.2)
    pillars = [at + 0.5 * np.column_stack([np.cos(turn), np.sin(turn)]) for at in (*PILLARS_M, *counterparts)]
    ground = np.stack(np.meshgrid(x[::3], y[::3], [-1.0]), axis=-1).reshape(-1, 3)
    return np.concatenate([upright(np.concatenate([*walls, *pillars])), ground])


def driven(robot: str, x: FloatArray, y: FloatArray) -> Trajectory:
    poses = se3.from_yaw(np.arctan2(np.gradient(y), np.gradient(x)), np.column_stack([x, y, 0 * x]))
    return Trajectory(robot, 10**18 + np.arange(len(x)) * 10**9, poses)


@dataclass(frozen=True)
class Team:
    truth: dict[str, Trajectory]
    clouds: dict[str, list[Float32Array]]

    @classmethod
    def of(cls, symmetric: bool) -> Team:
        along = np.linspace(0.0, 1.0, 16)
        truth = {
            "a": driven("a", -7 + 13 * along, 4 * np.sin(5 * along)),
            "b": driven("b", 6 - 11 * along, -3 + 6 * along**2),
        }
        rng, points = np.random.default_rng(3), hall(symmetric)
        clouds = {robot: [seen(points, pose, rng) for pose in path.poses] for robot, path in truth.items()}
        return cls(truth, clouds)

    def found(self, turn: FloatArray, log: WirelessLog | None = None, trusted: Sequence[str] = ()) -> list[RivalMap]:
        """Of a map in which the second robot is put elsewhere."""
        merged = {"a": self.truth["a"], "b": replace(self.truth["b"], poses=turn @ self.truth["b"].poses)}
        accepted = [
            Closure.from_measurement(
                KeyframeId("a", i), KeyframeId("b", j), se3.between(merged["a"].poses[i], merged["b"].poses[j]),
                np.diag(np.repeat([1e-4, 1e-2], 3)),
            ).accepted(Stage.ESTIMATE)
            for i, j in ((4, 12), (6, 10), (8, 8), (10, 6), (12, 4))
        ]  # fmt: skip
        keys = {KeyframeId(robot, k): cloud for robot, of in self.clouds.items() for k, cloud in enumerate(of)}
        config = Config()
        pool = RegistrationPool(config.registration, keys)
        return rival_maps(
            merged, accepted, self.clouds, self.truth, log or WirelessLog(), [("a", "b")] if trusted else [], config,
            lambda proposed: pool.register(proposed, NoProgress())[0],
        )  # fmt: skip


def seen(points: FloatArray, pose: FloatArray, rng: np.random.Generator) -> Float32Array:
    here = se3.transform(se3.inverse(pose), points)
    near = here[np.linalg.norm(here[:, :2], axis=1) < REACH_M]
    return (near + rng.normal(0, 0.01, near.shape)).astype(np.float32)


HALF_TURN = se3.from_yaw(np.pi, np.zeros(3))


@pytest.fixture(scope="module")
def symmetric() -> Team:
    return Team.of(symmetric=True)


@pytest.fixture(scope="module")
def log(symmetric: Team) -> WirelessLog:
    settings = RadioSettings(every_m=1.0, direction="reciprocal", paths=2)
    return simulate_wireless_from_poses(symmetric.truth, settings, seed=2)


@pytest.mark.parametrize("turn", [np.eye(4), HALF_TURN], ids=["right", "wrong"])
def test_without_radio_neither_half_turn_is_certain(symmetric: Team, turn: FloatArray) -> None:
    (rival,) = symmetric.found(turn)
    assert rival.pair == ("a", "b")
    assert abs(np.degrees(rival.turned_rad)) == pytest.approx(180, abs=5)
    assert 2 * rival.agreeing >= rival.tried
    assert "the map may be wrong: the scans fit as well if b is put" in rival.sentence
    assert rival.sentence.endswith("nothing tells which is true")


def test_the_radio_tells_that_the_map_is_right(symmetric: Team, log: WirelessLog) -> None:
    assert symmetric.found(np.eye(4), log) == []


def test_the_radio_tells_that_the_map_is_wrong(symmetric: Team, log: WirelessLog) -> None:
    (rival,) = symmetric.found(HALF_TURN, log)
    assert "what the robots measured of each other speaks for the other way" in rival.sentence


def test_a_certain_radio_is_no_judge_of_itself_where_it_measured_little(symmetric: Team, log: WirelessLog) -> None:
    few = WirelessLog(tuple(replace(m, paths=(), range_sigma_m=50.0) for m in log.measurements[:4]))
    (rival,) = symmetric.found(np.eye(4), few, trusted=["a and b"])
    assert "nor do the measurements of each other" in rival.sentence
    assert symmetric.found(HALF_TURN, log, trusted=["a and b"]) == []


def test_a_hall_that_is_not_symmetric_is_in_no_doubt() -> None:
    assert Team.of(symmetric=False).found(np.eye(4)) == []


def test_robots_that_no_closure_joins_have_no_map(symmetric: Team) -> None:
    nothing = rival_maps(symmetric.truth, [], symmetric.clouds, symmetric.truth, WirelessLog(), [], Config(), list)
    assert nothing == []
