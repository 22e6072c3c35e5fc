"""Two robots that wander on level ground and hear each other without any noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import AoaPath, FloatArray, Heading, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

from .one_road import straight

POSES = 60
SECOND_NS = 1_000_000_000
NO_DRIFT = DriftModel(
    translation_walk=1e-4, rotation_walk=1e-6, rotation_walk_turning=1e-6, translation_bias=0.0, rotation_bias=0.0
)


@dataclass(frozen=True, eq=False)
class Case:
    """Two robots, what they measured, and the true frame transform."""

    trajectories: dict[str, Trajectory]
    links: Links
    problem: AlignmentProblem
    settings: AlignmentSettings
    T_a_b: FloatArray

    @property
    def state(self) -> FloatArray:
        return self.problem.observations.state(self.T_a_b)


def _world(rng: np.random.Generator, climbing: bool) -> FloatArray:
    yaw = rng.uniform(-3, 3) + np.cumsum(rng.normal(0, 0.3, POSES))
    steps = np.column_stack([np.cos(yaw), np.sin(yaw), rng.normal(0, 1.5, POSES) * climbing])
    return se3.from_yaw(yaw, np.cumsum(steps, axis=0) + rng.uniform(-8, 8, 3) * [1, 1, climbing])


def _measured(
    world: dict[str, FloatArray], receiver: str, k: int, kind: str, elevated: bool, false_azimuths: FloatArray
) -> WirelessMeasurement:
    transmitter = "b" if receiver == "a" else "a"
    seen = se3.between(world[receiver][k], world[transmitter][k])[:3, 3]
    elevation = float(np.arctan2(seen[2], np.hypot(seen[0], seen[1]))) if elevated else None
    paths = (AoaPath(float(np.arctan2(seen[1], seen[0])), 0.15, elevation=elevation),)
    paths += tuple(AoaPath(float(azimuth), 0.15, elevation=0.5 if elevated else None) for azimuth in false_azimuths)
    ranged = float(np.linalg.norm(seen)) if kind != "bearing-only" else None
    return WirelessMeasurement(
        k * SECOND_NS, receiver, transmitter, ranged, None if ranged is None else 0.3,
        () if kind == "range-only" else paths,
    )  # fmt: skip


def _make_case(
    kind: str = "one-way",
    *,
    seed: int = 0,
    heard: int = 12,
    false_paths: int = 0,
    elevated: bool = False,
    tilt: FloatArray | None = None,
    odometry_of_b: Callable[[FloatArray], FloatArray] = lambda poses: poses,
    drift: DriftModel = NO_DRIFT,
    **changes: object,
) -> Case:
    """`kind` is heading, reciprocal, one-way, range-only or bearing-only; path 0 is the direct one."""
    rng = np.random.default_rng(seed)
    world = {name: _world(rng, elevated) for name in ("a", "b")}
    frames = {name: se3.from_yaw(rng.uniform(-3, 3), rng.uniform(-40, 40, 3) * [1, 1, elevated]) for name in world}
    if tilt is not None:
        frames["b"] = frames["b"] @ se3.exp(tilt)
    measurements = tuple(
        _measured(world, receiver, int(k), kind, elevated, rng.uniform(-np.pi, np.pi, false_paths))
        for k in np.linspace(0, POSES - 1, heard).astype(int)
        for receiver in (("a", "b") if kind == "reciprocal" else ("a",))
    )
    headings = tuple(
        Heading(k * SECOND_NS, name, float(se3.yaw(world[name][k])), 0.05)
        for name in world
        for k in range(POSES)
        if kind == "heading"
    )
    odometry = {name: se3.inverse(frames[name]) @ world[name] for name in world}
    odometry["b"] = odometry_of_b(odometry["b"])
    stamps_ns = np.arange(POSES, dtype=np.int64) * SECOND_NS
    trajectories = {name: Trajectory(name, stamps_ns, poses, drift) for name, poses in odometry.items()}
    settings = AlignmentSettings.model_validate(
        {"drift_inflation": 1.0, "radio": {"range_biased": 0.0, "static_radius_m": 0.0}} | changes
    )
    log = WirelessLog(measurements, headings)
    links = TeamLinks.of(trajectories, log, GatheringLimits.of(settings)).by_pair["a", "b"]
    problem = AlignmentProblem.of(links, trajectories, settings)
    return Case(trajectories, links, problem, settings, se3.between(frames["a"], frames["b"]))


@pytest.fixture
def make_case() -> Callable[..., Case]:
    return _make_case


@pytest.fixture
def world() -> dict[str, Trajectory]:
    """True trajectories of three robots on one road."""
    return {
        "alpha": straight("alpha", 60),
        "beta": straight("beta", 50, 5.0, reverse=True),
        "gamma": straight("gamma", 1, 9.0),
    }


@pytest.fixture
def odometry(world: dict[str, Trajectory]) -> dict[str, Trajectory]:
    return {name: truth.moved(se3.inverse(truth.poses[0])) for name, truth in world.items()}
