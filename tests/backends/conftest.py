"""Teams with known truth, and closures between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.drift import DriftModel
from wiclosure.types import Closure, FloatArray, KeyframeId, Trajectory

CLOSURE_COVARIANCE = np.diag(np.repeat([0.01**2, 0.1**2], 3))


@dataclass(frozen=True)
class Team:
    """Keyframe odometry in each robot's own frame, and the poses as they really were."""

    odometry: dict[str, Trajectory]
    truth: dict[str, Trajectory]
    T_world_odom: dict[str, FloatArray]

    def closure(
        self, query: tuple[str, int], match: tuple[str, int], *, error: FloatArray | None = None, noise: object = None
    ) -> Closure:
        """The true relative pose of two keyframes, perturbed on the right by the tangent vector `error`."""
        T = se3.between(self.truth[query[0]].poses[query[1]], self.truth[match[0]].poses[match[1]])
        if error is not None:
            T = T @ se3.exp(error)
        if isinstance(noise, np.random.Generator):
            T = T @ se3.exp(noise.multivariate_normal(np.zeros(6), CLOSURE_COVARIANCE))
        return Closure.from_measurement(KeyframeId(*query), KeyframeId(*match), T, CLOSURE_COVARIANCE)

    def false_closure(self, query: tuple[str, int], match: tuple[str, int], rng: np.random.Generator) -> Closure:
        """A registration of two places that have nothing to do with each other."""
        T = random_transforms(rng, 1, 10.0)[0]
        return Closure.from_measurement(KeyframeId(*query), KeyframeId(*match), T, CLOSURE_COVARIANCE)

    def random_closures(
        self,
        n: int,
        rng: np.random.Generator,
        a: str = "alpha",
        b: str = "beta",
        *,
        noise: object = None,
        limit: int | None = None,
    ) -> list[Closure]:
        """True closures of random keyframes of two robots, of their first `limit` ones where it is given."""
        pairs = rng.integers(0, limit or len(self.odometry[a]), (n, 2)).tolist()
        return [self.closure((a, i), (b, j), noise=noise) for i, j in pairs]

    @staticmethod
    def remeasured(closure: Closure, **changes: object) -> Closure:
        """The closure with another measured pose, covariance or evidence."""
        return replace(closure, measured=replace(closure.measured, **changes))


def random_transforms(rng: np.random.Generator, n: int, spread_m: float) -> FloatArray:
    return se3.from_rotation_translation(
        Rotation.random(n, rng=rng).as_matrix(), rng.normal(size=(n, 3)) * [spread_m, spread_m, 0.1 * spread_m]
    )


def make_team(
    seed: int = 0, robots: Sequence[str] = ("alpha", "beta"), n: int = 60, *, noise: float = 0.0, step_m: float = 1.0
) -> Team:
    """Robots on winding paths through one field; odometry noise is `noise` times what the drift model expects."""
    rng = np.random.default_rng(seed)
    drift = DriftModel(translation_bias=0.0, rotation_bias=0.0)
    odometry, truth, frames = {}, {}, {}
    for robot in robots:
        turn = rng.normal(0, 0.1, n - 1) + rng.normal(0, 0.03)
        tangent = np.zeros((n - 1, 6))
        tangent[:, 2], tangent[:, 3], tangent[:, 1] = turn, step_m, rng.normal(0, 0.01, n - 1)
        errors = np.zeros((n - 1, 6))
        turned = np.abs(turn)[:, None]
        rotation_sigma = np.sqrt(drift.rotation_walk**2 * step_m + drift.rotation_walk_turning**2 * turned)
        errors[:, :3] = rng.normal(0, 1, (n - 1, 3)) * rotation_sigma
        errors[:, 3:] = rng.normal(0, drift.translation_walk * np.sqrt(step_m), (n - 1, 3))
        steps, measured = se3.exp(tangent), se3.exp(tangent) @ se3.exp(noise * errors)
        start = se3.from_yaw(rng.uniform(-np.pi, np.pi), np.array([*rng.uniform(-15, 15, 2), 0.0]))
        frames[robot] = start
        stamps = np.arange(n, dtype=np.int64) * 1_000_000_000 + 1_700_000_000_000_000_000
        truth[robot] = Trajectory(robot, stamps, chain(start, steps), drift)
        odometry[robot] = Trajectory(robot, stamps, chain(np.eye(4), measured), drift)
    return Team(odometry, truth, frames)


def chain(start: FloatArray, steps: FloatArray) -> FloatArray:
    poses = [start]
    for step in steps:
        poses.append(poses[-1] @ step)
    return np.stack(poses)


@pytest.fixture(scope="session")
def team_maker():
    """`make_team`, as a fixture because test folders are no packages."""
    return make_team


@pytest.fixture(scope="session")
def g2o_loader():
    """Reads the recorded graph in a folder."""
    return lambda folder: read_graphs(sorted(folder.glob("*.g2o")))
