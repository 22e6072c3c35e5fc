"""Links without the constant errors that were estimated, and what all links leave open of these and of odometry scales.

Biases and scales of ranges, clocks and mounting angles are those of each pair of robots; the scale of its odometry is
each robot's.  With the nodes at their optimum, a Schur complement of the normal equations gives the errors that the
links leave open, and how the nodes follow them.  A scaled odometry moves its nodes away from the first one, and the
links see that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, IntArray, Trajectory
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
from wiclosure.wiclosure_filter.shared.independent_errors import ErrorSet
from wiclosure.wiclosure_filter.shared.joint_factors import add_links
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks
from wiclosure.wiclosure_filter.shared.square_root import SquareRoot

_OF_PAIR = (BIAS, RANGE_SCALE, CLOCK, AZIMUTH_A, AZIMUTH_B)
_ALL = (*_OF_PAIR, SCALE_A, SCALE_B)


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

    def pulls(self) -> tuple[IntArray, FloatArray]:
        """How the errors pull `(2 R, 6, 5)` at nodes `(2 R,)`, of which some stand there several times."""
        pull = self.A[:, :, :, None] * self.by_errors[:, None, None, :]
        return self.key.reshape(-1), pull.reshape(self.key.size, 6, -1)


def errors_of(alignment: FrameAlignment) -> PriorErrors | None:
    """What an alignment estimated, with what was known before; None where it did not."""
    if not alignment.calibration:
        return None
    value, sigma = np.array([(one.value, one.prior_sigma) for one in alignment.calibration]).T
    return PriorErrors(value, sigma)


def without_errors(kept: KeptLinks, errors: FloatArray, b: Trajectory) -> KeptLinks:
    """The links as they would be without errors `(7,)`; `b` is the trajectory of the second robot."""
    links = kept.links
    turn = -np.where(links.a_receives, errors[AZIMUTH_A], errors[AZIMUTH_B])
    R = se3.from_yaw(turn, np.zeros((len(turn), 3)))[:, :3, :3]
    moved = errors[CLOCK] * motion(b, links.index_b)[0]
    in_keyframe = np.einsum("lji,lj->li", b.poses[links.index_b, :3, :3], moved)
    corrected = replace(
        links,
        range_m=np.maximum(links.range_m - errors[BIAS], 0.0) / (1 + errors[RANGE_SCALE]),
        antenna_b=links.antenna_b + moved,
        antenna_keyframe_b=links.antenna_keyframe_b + in_keyframe,
    )
    return KeptLinks(
        corrected,
        np.einsum("lij,lj->li", R, kept.direction),
        R @ kept.direction_covariance @ np.swapaxes(R, 1, 2),
    )


def error_sets(
    team: TeamNodes,
    known: Mapping[tuple[str, str], PriorErrors],
    values: gtsam.Values,
    root: SquareRoot,
    robust_threshold: float,
) -> tuple[dict[tuple[int, int], ErrorSet], FloatArray]:
    """The errors of each pair of robots whose links are calibrated, and how the nodes move where they are estimated.

    The scale of an odometry stands in the sets of all pairs of its robot, in each with an equal share of its variance.

    Args:
        team: nodes and links.
        known: of each pair's errors.
        values: the nodes at their optimum.
        root: of their information.
        robust_threshold: of the kernel on links, in standard deviations.

    Returns:
        Sets by the numbers of two robots, and shifts `(K, 6)` of the nodes in their own axes.
    """
    number = {robot: n for n, robot in enumerate(team.nodes)}
    rows = {pair: _rows(team, pair, values, robust_threshold) for pair in known}
    scales = {robot: _Scale.of(team, robot, rows) for robot in team.nodes}
    pulled_by = {robot: root.solved(scale.nodes, scale.pull[:, :, None]) for robot, scale in scales.items()}
    scaled = {robot: root.whitened(*scale.nodes_moved(team.first[robot])) for robot, scale in scales.items()}
    pairs_of = {robot: sum(robot in pair for pair in known) for robot in team.nodes}
    sets, pulled = {}, np.zeros((len(root.place), 6))
    shift = np.zeros((len(root.place), 6))
    for (a, b), prior in known.items():
        own, of_a, of_b = rows[a, b], scales[a], scales[b]
        effects, places = _joined({0: root.solved(*own.pulls()), 5: pulled_by[a], 6: pulled_by[b]})
        by = np.column_stack([own.by_errors, of_a.by_scale[a, b], of_b.by_scale[a, b]])
        information = by.T @ by
        gradient = -own.b @ by
        for column, scale in ((5, of_a), (6, of_b)):
            information[column, column], gradient[column] = scale.information, scale.gradient
        flat = effects.reshape(-1, len(_ALL))
        sigma, value = prior.sigma[list(_ALL)], np.where(np.arange(len(_ALL)) < 5, prior.value[list(_ALL)], 0.0)
        covariance = np.asarray(np.linalg.inv(np.diag(sigma**-2.0) + information - flat.T @ flat), float)
        share = np.array([1.0] * len(_OF_PAIR) + [1 / pairs_of[a], 1 / pairs_of[b]])
        found = share * (covariance @ (gradient - value / sigma**2))
        pulled[places] += effects @ found
        for robot, column, scale in ((a, 5, of_a), (b, 6, of_b)):
            first = team.first[robot]
            shift[first : first + len(scale.moved), 3:] += scale.moved * found[column]
        both, places = _joined({0: (effects, places), 5: scaled[a], 6: scaled[b]})
        sets[number[a], number[b]] = ErrorSet.of(places, both * np.sqrt(share), covariance)
    everywhere = np.arange(len(root.place))
    return sets, shift + root.following(everywhere, pulled[:, :, None], everywhere)[:, :, 0]


@dataclass(frozen=True, eq=False)
class _Scale:
    """The scale of one odometry: what it moves, and what the links of the robot say of it.

    Args:
        moved: `(n, 3)` of the robot's nodes, by a scale of one more.
        pull: `(m, 6)` at nodes, some of them several times.
        nodes: `(m,)` numbers of these.
        by_scale: by pair of robots, derivative `(R,)` of the links' rows; zeros where the robot has no part.
        information, gradient: of the scale.
    """

    moved: FloatArray
    pull: FloatArray
    nodes: IntArray
    by_scale: Mapping[tuple[str, str], FloatArray]
    information: float
    gradient: float

    @classmethod
    def of(cls, team: TeamNodes, robot: str, rows: Mapping[tuple[str, str], LinkRows]) -> _Scale:
        position, first = team.nodes[robot].position, team.first[robot]
        moved = position - position[0]
        by_scale, information, gradient = {}, 0.0, 0.0
        nodes, pulls = [np.zeros(0, np.int64)], [np.zeros((0, 6))]
        for pair, own in rows.items():
            if robot in pair:
                end = pair.index(robot)
                by = -np.einsum("ri,ri->r", own.A[:, end, 3:], moved[own.key[:, end] - first])
                by_scale[pair] = by
                nodes.append(own.key.reshape(-1))
                pulls.append((own.A * by[:, None, None]).reshape(-1, 6))
                information += float(by @ by)
                gradient -= float(own.b @ by)
        return cls(moved, np.concatenate(pulls), np.concatenate(nodes), by_scale, information, gradient)

    def nodes_moved(self, first: int) -> tuple[IntArray, FloatArray]:
        """Numbers `(n,)` of the robot's nodes, and how they move `(n, 6)` in their own axes."""
        return first + np.arange(len(self.moved)), np.hstack([np.zeros_like(self.moved), self.moved])


def _joined(parts: Mapping[int, tuple[FloatArray, IntArray]]) -> tuple[FloatArray, IntArray]:
    """Effects `(c, 6, 7)` of all errors, and their places `(c,)`.

    Args:
        parts: by the first of some errors, effects `(c', 6, ...)` and their places; all together they add up.
    """
    places = np.unique(np.concatenate([at for _, at in parts.values()]))
    whole = np.zeros((len(places), 6, len(_ALL)))
    for first, (effects, at) in parts.items():
        of_some = effects.reshape(len(at), 6, -1)
        whole[np.searchsorted(places, at), :, first : first + of_some.shape[2]] += of_some
    return whole, places


def _rows(team: TeamNodes, pair: tuple[str, str], values: gtsam.Values, robust_threshold: float) -> LinkRows:
    (a, b), kept, (at_a, at_b) = pair, team.links[pair], team.ends[pair]
    velocity = motion(team.nodes[b].trajectory, kept.links.index_b)[0]
    return LinkRows.of(kept, (team.first[a] + at_a, team.first[b] + at_b), velocity, values, robust_threshold)
