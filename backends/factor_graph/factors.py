"""Factor graphs over keyframes, and how they are solved: the only place that speaks GTSAM's language."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray

from wiclosure.backends.closure_sets import ClosureSet
from wiclosure.backends.config import PoseGraphSettings
from wiclosure.backends.factor_graph.truncated_least_squares import truncated_weights
from wiclosure.types import BoolArray, FloatArray, IntArray, RadioLinks, Trajectory

ANCHOR = np.full(6, 1e-4)  # fixes the gauge; nothing pulls at it, so it is met exactly
LOOSE_ANCHOR = np.repeat([10.0, 1e4], 3)  # rad, m: holds a robot whose closures are all switched off, moves no other
STEP_FLOOR = np.diag(np.repeat([0.0001**2, 0.001**2], 3))  # a step on the spot, of which the drift model says nothing
GNC_FACTOR = 1.4  # growth of mu a step, as in the paper
GNC_FACTOR_SETTLED = 4.0  # where the last step hardly moved the estimate
GNC_SETTLED = 0.25  # of the residual at which a closure is switched off: what is hardly
GNC_STEPS = 150  # mu grows by more than 1e20 in these: residuals of any size
MANY_POSES = 1000  # from here on nested dissection gives sparser factors than minimum degree: half the time
CAUCHY_WIDTH = 2.3849  # 95 % efficiency on Gaussian errors


@dataclass(frozen=True, slots=True)
class Keys:
    """GTSAM keys of keyframes: symbols a0, a1, ... for the first robot, b0, ... for the second, and so on."""

    robots: tuple[str, ...]

    def __call__(self, robot: str, index: int) -> int:
        """The key of one keyframe."""
        return ((ord("a") + self.robots.index(robot)) << 56) + int(index)

    @staticmethod
    def same_robot(first: int, second: int) -> bool:
        """Whether two keys are of keyframes of one robot."""
        return first >> 56 == second >> 56

    def all(self, robot: str, indices: IntArray) -> list[int]:
        """The keys of many keyframes of one robot."""
        first = self(robot, 0)
        return [first + index for index in indices.tolist()]


def keyframes_in_factors(
    trajectories: Mapping[str, Trajectory], sets: Sequence[ClosureSet | RadioLinks]
) -> dict[str, NDArray[np.int64]]:
    """Keyframes that measurements hold, the first, and forks, by robot: a graph of these alone is equivalent."""
    ends: dict[str, list[NDArray[np.int64]]] = {
        robot: [np.zeros(1, np.int64), t.junctions] for robot, t in trajectories.items()
    }
    for closure_set in sets:
        ends[closure_set.robot_a].append(closure_set.index_a)
        ends[closure_set.robot_b].append(closure_set.index_b)
    return {robot: np.unique(np.concatenate(indices)) for robot, indices in ends.items()}


def odometry_covariances(trajectory: Trajectory, nodes: NDArray[np.int64], held: NDArray[np.int64]) -> FloatArray:
    """Covariances `(K - 1, 6, 6)` of the odometry steps between the keyframes at `nodes (K,)`.

    A chain of steps takes errors as independent, but the drift model's bias is the same error in every step: over a
    span of length S it grows with S, not with its root.  So each step carries its share of `bias^2 S^2`, S being the
    distance between the keyframes `held` by closures on both sides; each such span has the model's covariance.
    """
    first, second = trajectory.steps(nodes)
    if trajectory.step_covariances is not None:
        return trajectory.relative_covariance(first, second)
    length = trajectory.distance[second] - trajectory.distance[first]
    bounds = np.unique(np.concatenate([[0], held, [len(trajectory) - 1]]))
    span = np.searchsorted(bounds, first, side="right") - 1
    span_length = np.diff(trajectory.distance[bounds])[span]
    bias = np.repeat([trajectory.drift.rotation_bias, trajectory.drift.translation_bias], 3)
    shared = (length * (span_length - length))[:, None, None] * np.diag(bias**2)
    return np.asarray(trajectory.relative_covariance(first, second) + shared + STEP_FLOOR)


def odometry_factors(
    trajectories: Mapping[str, Trajectory],
    sets: Sequence[ClosureSet | RadioLinks],
    keys: Keys,
    nodes: Mapping[str, NDArray[np.int64]] | None = None,
) -> gtsam.NonlinearFactorGraph:
    """One factor for each odometry step between the keyframes of each robot, or only those at the indices `nodes`."""
    graph = gtsam.NonlinearFactorGraph()
    held = keyframes_in_factors(trajectories, sets)
    for robot, trajectory in trajectories.items():
        used = np.arange(len(trajectory)) if nodes is None else nodes[robot]
        if len(used) == 1:
            continue
        ends = trajectory.steps(used)
        steps, covariances = trajectory.relative_pose(*ends), odometry_covariances(trajectory, used, held[robot])
        names = (keys.all(robot, end) for end in ends)
        for first, second, step, covariance in zip(*names, steps, covariances, strict=True):
            graph.add(gtsam.BetweenFactorPose3(first, second, gtsam.Pose3(step), _noise(covariance)))
    return graph


def closure_factors(sets: Sequence[ClosureSet], keys: Keys) -> list[gtsam.BetweenFactorPose3]:
    """One factor for each closure, set after set."""
    return [
        gtsam.BetweenFactorPose3(a, b, gtsam.Pose3(T), _noise(covariance))
        for closure_set in sets
        for a, b, T, covariance in zip(
            keys.all(closure_set.robot_a, closure_set.index_a),
            keys.all(closure_set.robot_b, closure_set.index_b),
            closure_set.T_a_b,
            closure_set.covariance,
            strict=True,
        )
    ]


def anchor(key: int, pose: gtsam.Pose3, *, loose: bool = False) -> gtsam.PriorFactorPose3:
    """A prior that fixes one pose, or one that only keeps it from floating."""
    return gtsam.PriorFactorPose3(key, pose, gtsam.noiseModel.Diagonal.Sigmas(LOOSE_ANCHOR if loose else ANCHOR))


def prior(key: int, T: FloatArray, covariance: FloatArray) -> gtsam.PriorFactorPose3:
    """A direct measurement of one pose."""
    return gtsam.PriorFactorPose3(key, gtsam.Pose3(T), _noise(covariance))


def values_of(poses: Mapping[str, FloatArray], nodes: Mapping[str, NDArray[np.int64]] | None = None) -> gtsam.Values:
    """GTSAM's form of all poses, or only of those at the indices `nodes`."""
    keys, values = Keys(tuple(poses)), gtsam.Values()
    for robot, stack in poses.items():
        used = np.arange(len(stack)) if nodes is None else nodes[robot]
        for key, pose in zip(keys.all(robot, used), stack[used], strict=True):
            values.insert(key, gtsam.Pose3(pose))
    return values


def with_factors(
    graph: gtsam.NonlinearFactorGraph, factors: Sequence[gtsam.NonlinearFactor]
) -> gtsam.NonlinearFactorGraph:
    """A new graph of the given one's factors, then the others."""
    grown = gtsam.NonlinearFactorGraph(graph)
    for factor in factors:
        grown.add(factor)
    return grown


def least_squares(
    graph: gtsam.NonlinearFactorGraph, initial: gtsam.Values, order: gtsam.Ordering | None = None
) -> gtsam.Values:
    """Least squares by Levenberg-Marquardt.

    Raises:
        RuntimeError: the system is indeterminate or has no finite solution.
    """
    parameters = gtsam.LevenbergMarquardtParams()
    if order is not None:
        parameters.setOrdering(order)
    return gtsam.LevenbergMarquardtOptimizer(graph, initial, parameters).optimize()


def ordering(graph: gtsam.NonlinearFactorGraph) -> gtsam.Ordering:
    """One for many solutions, which pays for the search."""
    keys = (graph.at(n).keys() for n in range(graph.size()))
    joined = {key for of_factor in keys if len(of_factor) > 1 for key in of_factor}
    if len(joined) >= MANY_POSES and len(joined) == graph.keys().size():  # METIS cannot have a pose without neighbours
        return gtsam.Ordering.MetisNonlinearFactorGraph(graph)
    return gtsam.Ordering.ColamdNonlinearFactorGraph(graph)


def inliers_among(
    candidates: Sequence[gtsam.NoiseModelFactor],
    known: gtsam.NonlinearFactorGraph,
    initial: gtsam.Values,
    settings: PoseGraphSettings,
    degrees: int = 6,
) -> tuple[BoolArray, gtsam.Values]:
    """Which of the outlier candidates `(N,)` are inliers, given the known ones, and the estimate with them.

    Their residuals have so many degrees of freedom.

    Raises:
        RuntimeError: the system is indeterminate or has no finite solution.
    """
    if not candidates:
        return np.zeros(0, bool), least_squares(known, initial)
    limit = settings.inlier_limit(len(candidates), degrees)
    if settings.robust == "gnc":
        return _by_graduated_non_convexity(known, candidates, initial, limit)
    if settings.robust == "cauchy":
        kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY_WIDTH * settings.sigma_scale)
        robust = [f.cloneWithNewNoiseModel(gtsam.noiseModel.Robust.Create(kernel, f.noiseModel())) for f in candidates]
        estimate = least_squares(with_factors(known, robust), initial)
        return _chi_squares(candidates, estimate) < limit, estimate
    return np.ones(len(candidates), bool), least_squares(with_factors(known, candidates), initial)


def _by_graduated_non_convexity(
    known: gtsam.NonlinearFactorGraph,
    candidates: Sequence[gtsam.NoiseModelFactor],
    initial: gtsam.Values,
    limit: float,
) -> tuple[BoolArray, gtsam.Values]:
    """Yang et al., "Graduated non-convexity for robust spatial perception", RA-L 2020, truncated least squares.

    Each step goes on from the one before.  Where one Gauss-Newton iteration hardly moves the better half of the
    closures, that is the step, and mu grows faster.
    `gtsam.GncLMOptimizer` starts every step again from the initial values; on recorded odometry with one false closure
    in seven it ended with every closure switched off.
    """
    everything = with_factors(known, candidates)
    order = ordering(everything)
    estimate = least_squares(everything, initial, order)
    chi_square = _chi_squares(candidates, estimate)
    mu = limit / max(2 * float(chi_square.max()) - limit, limit)  # convex at first: the largest residual is inside
    for _ in range(GNC_STEPS):
        weights = truncated_weights(chi_square, limit, mu)
        if np.isin(weights, (0.0, 1.0)).all():
            break
        graph = with_factors(known, _weighted(candidates, weights))
        stepped = estimate.retract(graph.linearize(estimate).optimize(order))
        settled = _moved(chi_square, _chi_squares(candidates, stepped), limit) < GNC_SETTLED
        estimate = stepped if settled else least_squares(graph, estimate, order)
        chi_square = _chi_squares(candidates, estimate)
        mu *= GNC_FACTOR_SETTLED if settled else GNC_FACTOR
    return weights > 0.5, estimate


def _moved(before: FloatArray, after: FloatArray, limit: float) -> float:
    """Largest change of a residual among the better half of the closures, as a share of the residual at the limit."""
    better = before <= np.median(before)
    return float(np.abs(np.sqrt(after) - np.sqrt(before))[better].max() / np.sqrt(limit))


def _weighted(factors: Sequence[gtsam.NoiseModelFactor], weights: FloatArray) -> list[gtsam.NonlinearFactor]:
    """The factors with their information scaled; those of no weight are left out."""
    return [
        factor if weight == 1 else factor.cloneWithNewNoiseModel(_noise(_covariance(factor) / weight))
        for factor, weight in zip(factors, weights, strict=True)
        if weight > 0
    ]


def _covariance(factor: gtsam.NoiseModelFactor) -> FloatArray:
    noise = factor.noiseModel()
    assert isinstance(noise, gtsam.noiseModel.Gaussian)  # all factors are made here
    return np.asarray(noise.covariance())


def _chi_squares(factors: Sequence[gtsam.NonlinearFactor], estimate: gtsam.Values) -> FloatArray:
    return np.array([2 * factor.error(estimate) for factor in factors])


def _noise(covariance: FloatArray) -> gtsam.noiseModel.Gaussian:
    return gtsam.noiseModel.Gaussian.Covariance(covariance)
