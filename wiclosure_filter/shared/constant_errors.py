"""Constant errors of links and odometry as variables of the linearised joint estimate.

Biases and scales of ranges, clocks and mounting angles are those of each pair of robots; the scale of its odometry is
each robot's.  With the nodes at their optimum, each stands as a further variable beside them, so that one sparse
elimination tells what all links say of it, how the nodes follow, and what remains open in their covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from wiclosure.types import FloatArray, FrameAlignment, IntArray
from wiclosure.wiclosure_filter.drift.calibration import (
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
from wiclosure.wiclosure_filter.shared.joint_factors import JointFactors, Measured, measured
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

_OF_PAIR = (BIAS, RANGE_SCALE, CLOCK, AZIMUTH_A, AZIMUTH_B)
_SCALES = (SCALE_A, SCALE_B)
_SIZE = 6  # of every variable, as of a pose; what is more than a pair's five errors or a robot's scale moves nothing


@dataclass(frozen=True, eq=False)
class PriorErrors:
    """The errors of one pair of robots, see `alignment.calibration`.

    Args:
        value: `(7,)` taken out of the links already.
        sigma: `(7,)` of the prior; of a range bias, that of a blunder: only measurements vouch for its size.
    """

    value: FloatArray
    sigma: FloatArray


def errors_of(alignment: FrameAlignment) -> PriorErrors | None:
    """What an alignment estimated, with what was known before; None where it did not."""
    if not alignment.calibration:
        return None
    value, sigma = np.array([(one.value, one.held_sigma) for one in alignment.calibration]).T
    # An antenna delay that nobody calibrated moves b by as much, and no alignment stands for it: where the measurements
    # tell it to a metre or two, a usual one explains them nearly as well, and would vouch for being right.
    sigma[BIAS] = alignment.calibration[BIAS].blunder_sigma
    return PriorErrors(value, sigma)


def with_constant_errors(
    team: TeamNodes, factors: JointFactors, values: gtsam.Values, known: Mapping[tuple[str, str], PriorErrors]
) -> gtsam.GaussianFactorGraph:
    """All factors linearised, with the errors as variables: numbered after the nodes, in standard deviations.

    Args:
        team: nodes and links.
        factors: of the joint estimate.
        values: the nodes at their optimum.
        known: of each pair's errors.
    """
    graph = factors.others.linearize(values)
    of_pair = dict(zip(known, range(values.size(), values.size() + len(known)), strict=True))
    sigma = {robot: one.sigma[n] for pair, one in known.items() for robot, n in zip(pair, _SCALES, strict=True)}
    of_robot = {robot: number for number, robot in enumerate(sigma, values.size() + len(known))}
    _add_steps(graph, team, factors.steps.linearize(values), of_robot, sigma)
    for pair, links in factors.links.items():
        if pair in known:
            rows = _rows(team, pair, links.linearize(values))
            _add_links(graph, rows, of_pair[pair], known[pair])
        else:
            graph.push_back(links.linearize(values))
    for variable in (*of_pair.values(), *of_robot.values()):
        graph.add(variable, np.eye(_SIZE), np.zeros(_SIZE), gtsam.noiseModel.Unit.Create(_SIZE))
    return graph


def left_in_links(
    known: Mapping[tuple[str, str], PriorErrors], solved: FloatArray
) -> dict[tuple[str, str], FloatArray]:
    """Errors `(7,)` of each pair's links beyond the values that were taken out of them; 0 for scales of odometry.

    Args:
        known: of each pair's errors.
        solved: `(V, 6)` solution of `with_constant_errors`, without the nodes.
    """
    found = {pair: np.zeros(len(one.value)) for pair, one in known.items()}
    of_pair = list(_OF_PAIR)
    for (pair, one), own in zip(known.items(), solved, strict=False):  # robots follow
        found[pair][of_pair] = one.sigma[of_pair] * own[: len(of_pair)] - one.value[of_pair]
    return found


def _add_steps(
    graph: gtsam.GaussianFactorGraph,
    team: TeamNodes,
    steps: gtsam.GaussianFactorGraph,
    of_robot: Mapping[str, int],
    sigma: Mapping[str, float],
) -> None:
    """Odometry from node to node: a scaled one moves its nodes away from the first one."""
    number = 0
    for robot, nodes in team.nodes.items():
        moved = nodes.position - nodes.position[0]
        for n in range(len(nodes) - 1):
            factor, key = steps.at(number), team.first[robot] + n
            number += 1
            if robot not in of_robot:
                graph.push_back(factor)
                continue
            A, b = factor.jacobian()
            by_scale = np.zeros((len(b), _SIZE))
            by_scale[:, 0] = -sigma[robot] * (A[:, 3:6] @ moved[n] + A[:, 9:12] @ moved[n + 1])
            graph.add(key, A[:, :6], key + 1, A[:, 6:], of_robot[robot], by_scale, b, _unit(len(b)))


def _add_links(graph: gtsam.GaussianFactorGraph, rows: Sequence[LinkRows], variable: int, known: PriorErrors) -> None:
    """Links that were corrected by the value of each error, which is still to be found about zero."""
    value, sigma = known.value[list(_OF_PAIR)], known.sigma[list(_OF_PAIR)]
    for one in rows:
        by_errors = np.zeros((len(one.b), _SIZE))
        by_errors[:, : len(sigma)] = -one.by_errors * sigma
        (key_a, A_a), (key_b, A_b) = zip(one.keys, one.A, strict=True)
        graph.add(key_a, A_a, key_b, A_b, variable, by_errors, one.b - one.by_errors @ value, _unit(len(one.b)))


@dataclass(frozen=True, eq=False)
class LinkRows:
    """One linearised and whitened measurement of a link, residual `A x - b` of R rows.

    Args:
        keys: of the nodes at a and at b.
        A: `(2, R, 6)`.
        b: `(R,)`.
        by_errors: `(R, 5)` derivatives of `b` by the errors of `_OF_PAIR`.
    """

    keys: tuple[int, int]
    A: FloatArray
    b: FloatArray
    by_errors: FloatArray

    @classmethod
    def of(
        cls,
        kept: KeptLinks,
        keys: tuple[IntArray, IntArray],
        velocity_b: FloatArray,
        linear: gtsam.GaussianFactorGraph,
    ) -> list[LinkRows]:
        """Of all measurements of L links between nodes `keys`; `velocity_b (L, 3)` is m/s in b's odometry axes."""
        key_a, key_b = (of_end.tolist() for of_end in keys)
        rows = []
        for n, (link, kind) in enumerate(measured(kept)):
            factor = linear.at(n)
            jacobian, residual = factor.jacobian()
            A = np.stack([jacobian[:, :6], jacobian[:, 6:]])
            if factor.keys()[0] == key_b[link]:
                A = A[::-1]
            receiver = 0 if kept.links.a_receives[link] else 1
            by_errors = np.zeros((len(residual), len(_OF_PAIR)))
            by_errors[:, CLOCK] = -A[1, :, 3:] @ velocity_b[link]
            if kind is Measured.RANGE:
                weight = np.linalg.norm(A[0, 0, 3:])
                by_errors[0, BIAS], by_errors[0, RANGE_SCALE] = -weight, -weight * kept.links.range_m[link]
            elif kind is Measured.BEARING:
                by_errors[:, (AZIMUTH_A, AZIMUTH_B)[receiver]] = A[receiver, :, 2]
            rows.append(cls((key_a[link], key_b[link]), A, residual, by_errors))
        return rows


def _rows(team: TeamNodes, pair: tuple[str, str], linear: gtsam.GaussianFactorGraph) -> list[LinkRows]:
    (a, b), kept, (at_a, at_b) = pair, team.links[pair], team.ends[pair]
    velocity = motion(team.nodes[b].trajectory, kept.links.index_b)[0]
    return LinkRows.of(kept, (team.first[a] + at_a, team.first[b] + at_b), velocity, linear)


def _unit(rows: int) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Unit.Create(rows)
