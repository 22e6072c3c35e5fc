"""Where the joint estimate puts the nodes of all robots, and how odometry drifted (GTSAM).

Whether links contradict each other is told here; covariances cost more, and follow where they do not: `JointEstimate`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.covariance.cliques import Eliminated
from wiclosure.wiclosure_filter.covariance.square_root import SquareRoot
from wiclosure.wiclosure_filter.likelihood.frame_prior import FramePrior
from wiclosure.wiclosure_filter.shared.calibrated_links import without_errors
from wiclosure.wiclosure_filter.shared.constant_errors import PriorErrors, left_in_links, with_constant_errors
from wiclosure.wiclosure_filter.shared.drift_scale import drift_scale
from wiclosure.wiclosure_filter.shared.graph_nodes import TeamNodes
from wiclosure.wiclosure_filter.shared.joint_factors import (
    JointFactors,
    add_first_guess,
    add_height,
    frame_factors,
    link_factors,
    step_factors,
)

# The drift is scaled again where it grew by this factor, at most so often.
GROWN, MOST_RESCALINGS = 1.2, 5


@dataclass(frozen=True, eq=False)
class JointOptimum:
    """The most likely places of all nodes of one component.

    The frame is the odometry frame of the first robot.

    Args:
        team: nodes and links, with the drift scaled.
        T_world_node: `(K, 4, 4)` of all nodes.
        eliminated: information of all nodes, and of the constant errors after them.
        of_links: `(7,)` constant errors of each pair's links that it found beyond those taken out of them.
        dimensions: 2 where displacements are horizontal, 3 in space.
    """

    team: TeamNodes
    T_world_node: FloatArray
    eliminated: Eliminated
    of_links: Mapping[tuple[str, str], FloatArray]
    dimensions: int

    def misfits(self) -> dict[tuple[str, str], float]:
        """Median residual of the links of each two robots, without their constant errors (see `KeptLinks.misfit`)."""
        T, first = self.T_world_node, self.team.first
        found = {}
        for (a, b), kept in self.team.links.items():
            at_a, at_b = self.team.ends[a, b]
            errors = self.of_links.get((a, b))
            links = kept if errors is None else without_errors(kept, errors, self.team.nodes[b].trajectory)
            found[a, b] = links.misfit(T[first[a] + at_a], T[first[b] + at_b])
        return found


def optimise(
    team: TeamNodes,
    T_world_odom: Mapping[str, FloatArray],
    prior: FramePrior,
    *,
    robust_threshold: float,
    drift_weight: float,
    of_errors: Mapping[tuple[str, str], PriorErrors] | None = None,
) -> JointOptimum:
    """Optimises all nodes of one component.

    Args:
        team: nodes and links; the first robot's odometry frame becomes the shared frame.
        T_world_odom: first guess of each robot's odometry frame.
        prior: on how the other robots' frames lie in it.
        robust_threshold: of the kernel on ranges and bearings, in standard deviations.
        drift_weight: determined parameters that the drift model counts as, see `drift_scale`.
        of_errors: what is known of the constant errors of each pair's links and odometry.

    Raises:
        RuntimeError: of GTSAM.
        numpy.linalg.LinAlgError: some node is not determined.
    """
    initial = gtsam.Values()
    for robot, own in team.nodes.items():
        add_first_guess(initial, team.first[robot], own, T_world_odom[robot])
    team, factors, values = _with_drift_scaled(
        team, _factors(team, initial, prior, robust_threshold), initial, drift_weight
    )
    T_world_node = np.array([values.atPose3(k).matrix() for k in range(values.size())])
    eliminated = Eliminated.of(with_constant_errors(team, factors, values, of_errors or {}))
    of_links: dict[tuple[str, str], FloatArray] = {}
    if of_errors:
        moved, errors = np.split(eliminated.solution(), [len(T_world_node)])
        T_world_node, of_links = T_world_node @ se3.exp(moved), left_in_links(of_errors, errors)
    return JointOptimum(team, T_world_node, eliminated, of_links, prior.dimensions)


def _factors(team: TeamNodes, initial: gtsam.Values, prior: FramePrior, robust_threshold: float) -> JointFactors:
    nodes, first = team.nodes, team.first
    others = frame_factors(initial, {robot: first[robot] for robot in nodes}, prior)
    links = {}
    for (a, b), kept in team.links.items():
        at_a, at_b = first[a] + team.ends[a, b][0], first[b] + team.ends[a, b][1]
        links[a, b] = link_factors(kept, at_a, at_b, robust_threshold)
        sigma_m = kept.height_sigma_m(prior, nodes[a].trajectory, nodes[b].trajectory)
        if sigma_m is not None:
            middle = len(kept) // 2
            add_height(others, int(at_a[middle]), int(at_b[middle]), sigma_m)
    return JointFactors(step_factors(nodes, first), links, others)


def _with_drift_scaled(
    team: TeamNodes, factors: JointFactors, initial: gtsam.Values, drift_weight: float
) -> tuple[TeamNodes, JointFactors, gtsam.Values]:
    """The drift scale is estimated from the links, and the optimum repeated with it.

    Where the odometry is far worse than its model, the kernel had weakened the links that contradict it: then the scale
    grows again.
    """
    as_modelled, values, scaled, scale = factors.steps, _optimum(factors, initial), team, 1.0
    for _ in range(MOST_RESCALINGS):
        before = scale
        scale = drift_scale(
            as_modelled,
            factors.steps,
            values,
            # Given up at once: of a large team there is room for one.
            SquareRoot.of(Eliminated.of(factors.graph.linearize(values))),
            robots=len(team.nodes),
            prior_weight=drift_weight,
        )
        nodes = {robot: own.with_drift_scaled(scale) for robot, own in team.nodes.items()}
        scaled = replace(team, nodes=nodes)
        factors = replace(factors, steps=step_factors(nodes, team.first))
        values = _optimum(factors, values)
        if scale < GROWN * before:
            break
    return scaled, factors, values


def _optimum(factors: JointFactors, initial: gtsam.Values) -> gtsam.Values:
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-4)  # of the cost: far below what moves a pose by a centimetre
    parameters.setOrderingType("METIS")
    return gtsam.LevenbergMarquardtOptimizer(factors.graph, initial, parameters).optimize()
