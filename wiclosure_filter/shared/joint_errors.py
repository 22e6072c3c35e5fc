"""Constant errors beside the joint estimate: what they may still be shifts the nodes, and belongs to their covariance.

Biases and scales of ranges, clocks and mounting angles are those of each pair of robots, the scale of its odometry is
each robot's.  With the nodes at their optimum, one Schur complement of the normal equations gives the errors that the
links of all robots together leave open, and how the nodes follow them.  A scaled odometry moves its nodes away from the
first one, and the links see that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.alignment.calibration import (
    AZIMUTH_A,
    AZIMUTH_B,
    BIAS,
    CLOCK,
    RANGE_SCALE,
    SCALE_A,
    SCALE_B,
    motion,
)
from wiclosure.wiclosure_filter.shared.graph_nodes import TeamNodes
from wiclosure.wiclosure_filter.shared.joint_covariance import JointCovariance
from wiclosure.wiclosure_filter.shared.joint_factors import add_links
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

_OF_PAIR = (BIAS, RANGE_SCALE, CLOCK, AZIMUTH_A, AZIMUTH_B)


@dataclass(frozen=True, eq=False)
class PriorErrors:
    """The errors of one pair of robots, see `alignment.calibration`.

    Args:
        value: `(7,)` taken out of the links already.
        sigma: `(7,)` of the prior.
    """

    value: FloatArray
    sigma: FloatArray


@dataclass(frozen=True, eq=False)
class LinkRows:
    """Linearised and whitened residuals `A x - b` of a pair's links, R rows, with their derivatives by its errors.

    Args:
        key: `(R, 2)` the nodes at a and at b.
        A: `(R, 2, 6)`.
        b: `(R,)`.
        by_errors: `(R, 5)` of `b`, by the errors of `_OF_PAIR`.
    """

    key: IntArray
    A: FloatArray
    b: FloatArray
    by_errors: FloatArray

    @classmethod
    def of(
        cls,
        kept: KeptLinks,
        keys: tuple[IntArray, IntArray],
        velocity_b: FloatArray,
        values: gtsam.Values,
        robust_threshold: float,
    ) -> LinkRows:
        """Of L links between nodes `keys`; `velocity_b (L, 3)` is m/s in b's odometry axes."""
        parts = []
        for row in range(len(kept)):
            graph, one, links = gtsam.NonlinearFactorGraph(), kept.subset(np.array([row])), kept.links
            at_a, at_b = int(keys[0][row]), int(keys[1][row])
            add_links(graph, one, np.array([at_a]), np.array([at_b]), robust_threshold)
            linear = graph.linearize(values)
            for n in range(linear.size()):
                factor = linear.at(n)
                jacobian, b = factor.jacobian()
                first = list(factor.keys()).index(at_a)
                A = np.stack([jacobian[:, 6 * k : 6 * k + 6] for k in (first, 1 - first)], axis=1)
                by_errors = np.zeros((len(b), len(_OF_PAIR)))
                by_errors[:, 2] = -A[:, 1, 3:] @ velocity_b[row]
                receiver = 0 if links.a_receives[row] else 1
                if len(b) == 1:
                    weight = np.linalg.norm(A[0, 0, 3:])
                    by_errors[0, :2] = -weight, -weight * links.range_m[row]
                elif len(b) == 3:  # a bearing; six rows are a compass
                    by_errors[:, 3 + receiver] = A[:, receiver, 2]
                parts.append((np.tile([at_a, at_b], (len(b), 1)), A, b, by_errors))
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


@dataclass(frozen=True, eq=False)
class JointErrors:
    """What E errors may still be, and how K nodes follow them.

    Args:
        shift: `(K, 6)` by which the nodes move to the optimum of nodes and errors together.
        columns: `(K, 6, E)` that independent errors of one standard deviation move the nodes.
    """

    shift: FloatArray
    columns: FloatArray

    @classmethod
    def of(
        cls,
        team: TeamNodes,
        known: Mapping[tuple[str, str], PriorErrors],
        values: gtsam.Values,
        covariance: JointCovariance,
        robust_threshold: float,
    ) -> JointErrors:
        """Beside the optimum of the nodes.

        Args:
            team: nodes and links.
            known: for each pair whose links are calibrated, what of the errors is known before.
            values: the nodes at their optimum.
            covariance: theirs, each node's in its own axes, were there no errors.
            robust_threshold: of the kernel on links, in standard deviations.
        """
        robots, size = list(team.nodes), len(team.linked)
        count = len(robots) + len(_OF_PAIR) * len(known)
        sigma, value = np.ones(count), np.zeros(count)
        moved, pull = np.zeros((size, 6, count)), np.zeros((size, 6, count))
        information, gradient = np.zeros((count, count)), np.zeros(count)
        for column, robot in enumerate(robots):
            position = team.nodes[robot].position
            first = team.first[robot]
            moved[first : first + len(position), 3:, column] = position - position[0]
        for number, ((a, b), prior) in enumerate(known.items()):
            own = len(robots) + len(_OF_PAIR) * number + np.arange(len(_OF_PAIR))
            sigma[own], value[own] = prior.sigma[list(_OF_PAIR)], prior.value[list(_OF_PAIR)]
            sigma[robots.index(a)], sigma[robots.index(b)] = prior.sigma[[SCALE_A, SCALE_B]]
            kept, (at_a, at_b) = team.links[a, b], team.ends[a, b]
            velocity = motion(team.nodes[b].trajectory, kept.links.index_b)[0]
            keys = (team.first[a] + at_a, team.first[b] + at_b)
            rows = LinkRows.of(kept, keys, velocity, values, robust_threshold)
            by_errors = -np.einsum("rki,rkie->re", rows.A, moved[rows.key])
            by_errors[:, own] += rows.by_errors
            for end in range(2):
                np.add.at(pull, rows.key[:, end], rows.A[:, end, :, None] * by_errors[:, None, :])
            information += by_errors.T @ by_errors
            gradient += rows.b @ by_errors
        follow = np.einsum("kir,kie->re", covariance.factor, pull)
        of_errors = np.linalg.inv(np.diag(sigma**-2.0) + information - follow.T @ follow)
        by_nodes = moved + covariance.factor @ follow
        found = of_errors @ (gradient - value / sigma**2)
        return cls(by_nodes @ found, by_nodes @ np.linalg.cholesky(of_errors))

    def moved(self, T_world_node: FloatArray) -> FloatArray:
        """The nodes `(K, 4, 4)` at the optimum of nodes and errors."""
        return np.asarray(T_world_node @ se3.exp(self.shift))
