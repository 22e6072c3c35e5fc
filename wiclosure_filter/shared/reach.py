"""Which robots of a joint estimate can meet at all, and on which stretches: bounds that cost no table of covariances.

With p the positions and dx, dt the errors of position and rotation in the shared axes, the displacement between node n
of robot a and node m of robot b errs, through the middle nodes r and s of both, by

    dx_m - dx_n = dt_r x (p_m - p_n)                              the shared frame's own turn
                + (dx_s - dx_r - dt_r x (p_s - p_r))              where the middle of b lies from that of a
                + (dt_s - dt_r) x (p_m - p_s)                     how b is turned against a
                + (dx_m - dx_s - dt_s x (p_m - p_s)) - (the same of n and r)     each robot's own shape

Standard deviations add up at most.  No term but the shared frame's own turn grows with the way from the first robot, so
that the bound holds as tightly in a large team.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, IntArray
from wiclosure.wiclosure_filter.search.gates import Gate
from wiclosure.wiclosure_filter.search.pair_model import KeyframePlaces
from wiclosure.wiclosure_filter.search.segments import LEAF

# m^2: no bound on how flat a covariance may be, so that only its largest axis rules pairs out.
NO_SPREAD = 1e-12


@dataclass(frozen=True, eq=False)
class Boxes:
    """S stretches of a robot's path.

    Args:
        low, high: `(S, d)` corners of the boxes about the keyframes, m.
        node_low, node_high: `(S, 3)` the same of the nodes that the keyframes lie between.
        shape_sigma: `(S,)` m, of these nodes in the frame of the middle node.
        own_variance: `(S,)` m^2 of the keyframes about their nodes.
    """

    low: FloatArray
    high: FloatArray
    node_low: FloatArray
    node_high: FloatArray
    shape_sigma: FloatArray
    own_variance: FloatArray


@dataclass(frozen=True, eq=False)
class Reach:
    """One robot in a joint estimate, without the others.

    Args:
        places: its keyframes.
        position: `(3,)` of its middle node.
        sigma_m: largest standard deviation of a node's position in the shared frame.
        turn: `(3, 3)` covariance of the middle node's rotation in the shared frame, rad^2.
        boxes: of leaves of the overlap search.
    """

    places: KeyframePlaces
    position: FloatArray
    sigma_m: float
    turn: FloatArray
    boxes: Boxes

    @classmethod
    def of(
        cls, places: KeyframePlaces, nodes: FloatArray, middle: int, own: FloatArray, with_middle: FloatArray
    ) -> Reach:
        """From a robot's keyframes, and its n nodes in the shared axes.

        Args:
            places: the keyframes.
            nodes: `(n, 3)` positions.
            middle: one of the nodes.
            own: `(n, 6, 6)` their covariances.
            with_middle: `(n, 6, 6)` the same of each with the middle one.
        """
        d = places.positions.shape[1]
        shape_sigma = _sigma(_shape(nodes - nodes[middle], own, own[middle], with_middle)[:, :d, :d])
        starts = np.arange(0, len(places), LEAF)
        ends = np.minimum(starts + LEAF, len(places)) - 1
        touched = [
            slice(a, min(b + 2, len(nodes))) for a, b in zip(places.node[starts], places.node[ends], strict=True)
        ]
        boxes = Boxes(
            np.minimum.reduceat(places.positions, starts),
            np.maximum.reduceat(places.positions, starts),
            np.array([nodes[part].min(axis=0) for part in touched]),
            np.array([nodes[part].max(axis=0) for part in touched]),
            np.array([shape_sigma[part].max() for part in touched]),
            np.maximum.reduceat(places.own_variance, starts),
        )
        sigma_m = float(_sigma(own[:, 3 : 3 + d, 3 : 3 + d]).max())
        return cls(places, nodes[middle], sigma_m, own[middle, :3, :3], boxes)


def near_enough(robots: list[Reach], gate: Gate) -> BoolArray:
    """`(R, R)` which robots may meet by their boxes and what is known of each alone."""
    low, high = (np.array([extreme(r.places.positions, axis=0) for r in robots]) for extreme in (np.min, np.max))
    sigma = np.array([r.sigma_m for r in robots])
    own = np.array([r.boxes.own_variance.max() for r in robots])
    near = np.zeros((len(robots), len(robots)), bool)
    for row in range(len(robots)):  # row by row: what is in between would be as large as all pairs, several times
        gap = np.maximum(np.maximum(low[row] - high, low - high[row]), 0.0)
        variance = (sigma[row] + sigma) ** 2 + own[row] + own
        near[row] = gate.may_keep(np.linalg.norm(gap, axis=1), variance, np.full(len(robots), NO_SPREAD))
    return near


def meeting_stretches(a: Reach, b: Reach, of_middles: FloatArray, gate: Gate) -> tuple[slice, slice] | None:
    """Keyframes of both robots between which all pairs are that the gate may keep; None where it keeps none.

    Args:
        a: one robot.
        b: the other.
        of_middles: `(12, 12)` covariance of their middle nodes, rotation first, in the shared axes.
        gate: decides on pairs.
    """
    apart, turned = _between(a, b, of_middles)
    ours, theirs, d = a.boxes, b.boxes, a.places.positions.shape[1]
    gap = np.maximum(ours.low[:, None] - theirs.high, theirs.low - ours.high[:, None])
    farthest = np.maximum(ours.node_high[:, None] - theirs.node_low, theirs.node_high - ours.node_low[:, None])
    lever = np.maximum(theirs.node_high - b.position, b.position - theirs.node_low)
    sigma = (
        _swing(a.turn, farthest, d)
        + _sigma(apart[:d, :d])
        + _swing(turned, lever, d)
        + ours.shape_sigma[:, None]
        + theirs.shape_sigma
    )
    variance = sigma**2 + ours.own_variance[:, None] + theirs.own_variance
    distance = np.linalg.norm(np.maximum(gap, 0.0), axis=2)
    kept = gate.may_keep(distance.ravel(), variance.ravel(), np.full(distance.size, NO_SPREAD))
    kept = kept.reshape(distance.shape)
    if not kept.any():
        return None
    of_a, of_b = np.flatnonzero(kept.any(axis=1)), np.flatnonzero(kept.any(axis=0))
    return _stretch(of_a, len(a.places)), _stretch(of_b, len(b.places))


def _stretch(leaves: IntArray, size: int) -> slice:
    return slice(int(leaves[0]) * LEAF, min((int(leaves[-1]) + 1) * LEAF, size))


def _between(a: Reach, b: Reach, of_middles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Covariances `(3, 3)`, m^2 and rad^2, of where the middle of b lies from that of a, and of how it is turned."""
    moved = np.hstack([se3.skew(b.position - a.position), -np.eye(3), np.zeros((3, 3)), np.eye(3)])
    turned = np.hstack([-np.eye(3), np.zeros((3, 3)), np.eye(3), np.zeros((3, 3))])
    return moved @ of_middles @ moved.T, turned @ of_middles @ turned.T


def _swing(turn: FloatArray, lever: FloatArray, dimensions: int) -> FloatArray:
    """Largest standard deviations, m, of points at levers `(..., 3)` about which there is a rotation error."""
    if dimensions == 3:
        return np.asarray(_sigma(turn) * np.linalg.norm(lever, axis=-1))
    horizontal, upright = np.linalg.norm(lever[..., :2], axis=-1), np.abs(lever[..., 2])
    return np.asarray(np.sqrt(turn[2, 2]) * horizontal + _sigma(turn[:2, :2]) * upright)


def _shape(lever: FloatArray, own: FloatArray, middle: FloatArray, with_middle: FloatArray) -> FloatArray:
    """`(n, 3, 3)` covariances of the nodes' positions at levers `(n, 3)` in the frame of the middle one."""
    by_middle = np.concatenate([se3.skew(lever), np.tile(-np.eye(3), (len(lever), 1, 1))], axis=2)
    mixed = with_middle[:, 3:] @ np.swapaxes(by_middle, 1, 2)
    of_middle = by_middle @ middle @ np.swapaxes(by_middle, 1, 2)
    return np.asarray(own[:, 3:, 3:] + of_middle + mixed + np.swapaxes(mixed, 1, 2))


def _sigma(covariance: FloatArray) -> FloatArray:
    """`(...)` square roots of the largest variances of `(..., d, d)`."""
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariance)[..., -1], 0.0)))
