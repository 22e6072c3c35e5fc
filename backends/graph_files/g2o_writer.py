"""The estimate as a g2o file: every factor, and what became of every closure."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.factor_graph.earth_factors import OUTVOTED, weights_of_fixes, weights_of_up
from wiclosure.backends.factor_graph.factors import Keys
from wiclosure.errors import OutputError
from wiclosure.types import Closure, FloatArray, measured_poses

_WRITTEN = gtsam.BetweenFactorPose3, gtsam.PriorFactorPose3, gtsam.AttitudeFactorPose3, gtsam.GPSFactorArm


@dataclass(frozen=True, slots=True)
class Form:
    """How poses and edges are written: tags, the columns of a pose, and which axes the information is over."""

    vertex: str
    edge: str
    pose: Callable[[FloatArray], FloatArray]
    axes: tuple[int, ...]

    def poses(self, T: FloatArray) -> list[str]:
        """The columns of each transform, every digit kept."""
        return [" ".join(map(repr, row)) for row in self.pose(T).tolist()]

    def edges(self, T: FloatArray, information: FloatArray) -> Iterator[str]:
        """Transform and upper triangle of the information of each edge."""
        axes = np.array(self.axes)
        upper = information[:, axes][:, :, axes][:, *np.triu_indices(len(axes))]
        return (f"{pose} {' '.join(map(repr, row))}" for pose, row in zip(self.poses(T), upper.tolist(), strict=True))


def _quaternion_columns(T: FloatArray) -> FloatArray:
    return np.concatenate([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()], axis=1)


def _planar_columns(T: FloatArray) -> FloatArray:
    return np.column_stack([T[:, :2, 3], se3.yaw(T)])


SPATIAL = Form("VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", _quaternion_columns, (3, 4, 5, 0, 1, 2))  # g2o: translation first
PLANAR = Form("VERTEX_SE2", "EDGE_SE2", _planar_columns, (3, 4, 2))


def write_g2o(
    result: GraphResult,
    path: Path,
    keys: Mapping[str, np.ndarray] | None = None,
    form: Form = SPATIAL,
    tell: Collection[str] = (),
) -> None:
    """Writes the graph for other solvers: odometry and accepted closures as edges, rejected closures as comments.

    `gtsam.writeG2o` keeps six digits, 1 cm on a path of kilometres; here every digit is kept.  The first pose of each
    component is fixed.

    Args:
        result: the estimate.
        path: the file.
        keys: number of each keyframe `(N,)` by robot.  By default keyframes are numbered from 0 over all robots, in the
            order of `result.trajectories`, because g2o takes 32 bits and GTSAM's own keys need 64; comments at the top
            say which robot has which.
        form: `PLANAR` writes what planar graphs hold.
        tell: robots that `keys` do not name; comments at the top say which keys they have.

    Raises:
        OutputError: the file cannot be written.
    """
    sizes = {robot: len(trajectory) for robot, trajectory in result.trajectories.items()}
    starts = dict(zip(sizes, np.cumsum([0, *sizes.values()]).tolist(), strict=False))
    numbers = keys if keys is not None else {robot: starts[robot] + np.arange(size) for robot, size in sizes.items()}
    if keys is None:
        lines = [_range(robot, numbers[robot]) for robot in sizes]
    else:
        lines = [_spans(robot, numbers[robot]) for robot in sizes if robot in tell]
    for robot, trajectory in result.trajectories.items():
        poses = zip(numbers[robot].tolist(), form.poses(trajectory.poses), strict=True)
        lines += [f"{form.vertex} {number} {pose}" for number, pose in poses]
    lines += [f"FIX {numbers[component[0]][0]}" for component in result.components]
    lines += [
        *_without_edges(result),
        *_earth(result, numbers),
        *_accepted(result, numbers, form),
        *_rejected(result, numbers, form),
    ]
    try:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error


def _range(robot: str, numbers: np.ndarray) -> str:
    return f"# keyframes of {robot}: vertices {numbers[0]} to {numbers[-1]}"


def _spans(robot: str, numbers: np.ndarray) -> str:
    runs = np.split(np.sort(numbers), np.flatnonzero(np.diff(np.sort(numbers)) != 1) + 1)
    return f"# keys of {robot}: " + " ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def _without_edges(result: GraphResult) -> Iterator[str]:
    """A comment on factors that the file cannot hold."""
    factors = map(result.graph.at, range(result.graph.size()))
    count = sum(not isinstance(f, _WRITTEN) for f in factors)
    if count:
        yield f"# {count} ranges and bearings, and what gravity tells, are not in this file: g2o has no edges for them"


def _earth(result: GraphResult, numbers: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Comments for what g2o has no edges for: vertex, direction up in its axes or position, sigma, and its weight."""
    if not result.ground.earth:
        return
    yield "# UP vertex x y z sigma_rad, GNSS vertex east north up sigmas_m: then the weight in the estimate"
    for robot, up in result.ground.earth.up.items():
        weight = weights_of_up(up, result.trajectories[robot].poses)
        yield from _comments("UP", numbers[robot][up.index], [up.up_body, up.sigma_rad[:, None]], weight)
    for robot, fixes in result.ground.earth.fixes.items():
        weight = weights_of_fixes(fixes, result.trajectories[robot].poses)
        weight = weight if robot in result.ground.placed else np.zeros(len(fixes))
        yield from _comments("GNSS", numbers[robot][fixes.index], [fixes.position_enu, fixes.sigma_enu], weight)


def _comments(tag: str, vertices: np.ndarray, columns: list[FloatArray], weight: FloatArray) -> Iterator[str]:
    for vertex, row, w in zip(vertices.tolist(), np.hstack(columns).tolist(), weight.tolist(), strict=True):
        yield f"# {tag} {vertex} {' '.join(map(repr, row))}: {'outvoted' if w < OUTVOTED else 'used'}, weight {w:.2f}"


def _accepted(result: GraphResult, numbers: Mapping[str, np.ndarray], form: Form) -> Iterator[str]:
    """Odometry, then each accepted closure after a comment that says why."""
    keys = Keys(tuple(result.trajectories))
    vertex = {keys(r, n): number for r, own in numbers.items() for n, number in enumerate(own.tolist())}
    reasons = {
        frozenset((keys(c.query.robot, c.query.index), keys(c.match.robot, c.match.index))): c.reason
        for c in result.accepted
    }
    edges = [
        f
        for f in map(result.graph.at, range(result.graph.size()))
        if isinstance(f, gtsam.BetweenFactorPose3)
        and (Keys.same_robot(*f.keys()) or frozenset(f.keys()) in reasons)  # not what only holds two frames level
    ]
    if not edges:
        return
    information = np.stack([_information(f) for f in edges])
    measured = np.stack([f.measured().matrix() for f in edges])
    for factor, edge in zip(edges, form.edges(measured, information), strict=True):
        first, second = factor.keys()
        if reason := reasons.get(frozenset((first, second)), ""):
            yield f"# accepted: {reason}"
        yield f"{form.edge} {vertex[first]} {vertex[second]} {edge}"


def _rejected(result: GraphResult, numbers: Mapping[str, np.ndarray], form: Form) -> Iterator[str]:
    """Two comments for each rejected closure that states a measurement: why, and the edge that it would have been."""
    rejected = [c for c in result.closures if c.rejected_at is not None and _measures(c)]
    if not rejected:
        return
    T_query_match, covariance = measured_poses(rejected)
    edges = form.edges(T_query_match, np.asarray(np.linalg.inv(covariance)))
    for closure, edge in zip(rejected, edges, strict=True):
        first, second = (numbers[key.robot][key.index] for key in (closure.query, closure.match))
        yield f"# rejected: {closure.reason}"
        yield f"# {form.edge} {first} {second} {edge}"


def _measures(closure: Closure) -> bool:
    if closure.measured is None or not np.isfinite(closure.measured.T_query_match).all():
        return False
    covariance = closure.measured.covariance
    return bool(np.isfinite(covariance).all() and np.linalg.eigvalsh(covariance)[0] > 0)


def _information(factor: gtsam.BetweenFactorPose3) -> FloatArray:
    noise = factor.noiseModel()
    assert isinstance(noise, gtsam.noiseModel.Gaussian)  # all factors of the final graph are made here
    return np.asarray(noise.information())
