"""Which closures within groups of robots that are joined already are inliers, and the estimate by them.

Odometry is a known inlier.  Graduated non-convexity finds the inliers from any start; then each closure is checked
against what all others predict, with the covariance of that prediction: a closure that nothing but odometry opposes
pulls the estimate to itself, and its own residual would not tell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import f

from wiclosure import se3
from wiclosure.backends.least_squares.chordal import cheaper_start
from wiclosure.backends.least_squares.edges import DEGREES, Edges, degrees_of_true_ones, mahalanobis_squared
from wiclosure.backends.least_squares.system import STEPS, Descent, System
from wiclosure.backends.least_squares.variance_components import VarianceComponents
from wiclosure.types import BoolArray, FloatArray, IntArray

SAMPLES = 100  # of the noise: a sampled 6 x 6 covariance is then exact to some ten per cent
REDUNDANCY_FLOOR = 1e-5  # of a closure that nothing checks
CHECKED = 0.05  # share of an edge's variance that its residual shows: with less, it tells nothing of sigma
MU_GROWTH = 1.4  # of mu
MOST_GNC_STEPS = 150
NEWTON_STEPS = 5  # of Gauss-Newton while mu stays
CHECK_ROUNDS = 12
EDGES_AT_ONCE = 1024  # bounds memory
FEW_STEPS = 5  # of Levenberg-Marquardt, in which an estimate without gross outliers converges
NEAREST = 5  # outliers at least, up to the distance of which they are counted
WORST = 0.25  # of the largest distance: closures above are dropped first, as the others may be off because of these;
# of those that came back, the worst alone


@dataclass(frozen=True, eq=False)
class Settled:
    """The estimate within each group.

    Args:
        poses: `(N, 4, 4)` in the groups' frames.
        wander: `(N, 6, S)` samples of their errors, as tangent vectors in the groups' frames.
        inlier: `(M,)` closures that the estimate rests on.
        distance: `(M,)` squared Mahalanobis distance of each closure from what the others predict; NaN outside groups.
        redundant: `(K,)` the same of those odometry edges and inliers that others check: what sigma is estimated from.
        strain: `(N,)` by how much each odometry edge, were it left out, would lower the cost, to first order.
        components: what the residuals say of rotation and translation apart.
    """

    poses: FloatArray
    wander: FloatArray
    inlier: BoolArray
    distance: FloatArray
    redundant: FloatArray
    strain: FloatArray = field(default_factory=lambda: np.zeros(0))
    components: VarianceComponents = field(default_factory=VarianceComponents.none)

    def scaled(self, scale: float) -> Settled:
        """The same with all standard deviations so many times as large."""
        squared = scale**2
        return replace(
            self,
            wander=scale * self.wander,
            distance=self.distance / squared,
            redundant=self.redundant / squared,
            strain=self.strain / squared,
            components=replace(self.components, squared=self.components.squared / squared),
        )


def outlier_limit(closures: int, probability: float, degrees: int = DEGREES) -> float:
    """Squared distance that not one of so many true closures exceeds, with this probability.

    Hotelling's distribution rather than chi-square, because the covariances are sampled.
    """
    freedom = SAMPLES - degrees + 1
    return float(f.ppf(probability ** (1.0 / max(closures, 1)), degrees, freedom) * degrees)


def fewest_errors(inliers: int, outliers: FloatArray, limit: float, degrees: int = DEGREES) -> float:
    """Squared distance, up to `limit`, that leaves the fewest true closures beyond it and false ones within.

    True ones are distributed as `outlier_limit` has it.  False ones are as dense around the prediction as beyond the
    limit, as far as there are some: their number grows with the volume of the ellipsoid.

    Args:
        inliers: how many closures are within the limit.
        outliers: squared distances `(K,)` of the others.
        limit: squared distance from which a closure is an outlier, however few there are.
        degrees: of freedom.
    """
    if not len(outliers) or not np.isfinite(limit):
        return limit
    freedom = SAMPLES - degrees + 1
    bounds = limit * np.linspace(0.1, 1.0, 91)
    farthest = max(2.0 * limit, float(np.sort(outliers)[:NEAREST][-1]))
    volume = farthest ** (degrees / 2) - limit ** (degrees / 2)
    false = (outliers <= farthest).sum() / volume * bounds ** (degrees / 2)
    true = inliers * f.sf(bounds / degrees, degrees, freedom)
    return float(bounds[np.argmin(true + false)])


def graduated(
    odometry: Edges, loops: Edges, starts: Sequence[FloatArray], held: IntArray, limit: float
) -> tuple[BoolArray, FloatArray]:
    """Inliers `(M,)` among loops, and poses, by graduated non-convexity with truncated least squares.

    Yang et al., RA-L 2020; each step is a few of Gauss-Newton and goes on from the one before.  Where all residuals of
    the plain solution from one of the starts are within the limit, that is the answer; else the steps begin at that
    from the last start, and it is the answer where it costs less than what came of them.
    """
    system, count = System.of(odometry + loops, starts[0], held), len(odometry)
    for start in starts:
        plain = poses = system.solved(start)
        chi_square = system.chi_squares(poses)[count:]
        if (chi_square <= limit).all():
            return np.ones(len(loops), bool), poses
    mu = limit / max(2.0 * float(chi_square.max()) - limit, limit)
    for _ in range(MOST_GNC_STEPS):
        weights = _truncated_weights(chi_square, limit, mu)
        if not weights[chi_square > limit].any():  # none is undecided: mu only brings the others to full weight
            break
        poses = system.solved(poses, np.concatenate([np.ones(count), weights]), steps=NEWTON_STEPS)
        chi_square = system.chi_squares(poses)[count:]
        mu *= MU_GROWTH
    poses = system.solved(poses, np.concatenate([np.ones(count), chi_square <= limit]))
    best = min((poses, plain), key=lambda found: truncated_cost(system.chi_squares(found), count, limit))
    return system.chi_squares(best)[count:] <= limit, best


def truncated_cost(chi_squares: FloatArray, known: int, limit: float) -> float:
    """Of known inliers, which come first, in full; of the others up to the limit."""
    return float(chi_squares[:known].sum() + np.minimum(chi_squares[known:], limit).sum())


def _truncated_weights(chi_square: FloatArray, limit: float, mu: float) -> FloatArray:
    """Weights `(N,)` of the surrogate cost (eq. 14 of Yang et al.): 1 inside, 0 outside, falling between."""
    inside, outside = limit * mu / (mu + 1), limit * (mu + 1) / mu
    between = np.sqrt(limit * mu * (mu + 1) / np.clip(chi_square, inside, outside)) - mu
    return np.where(chi_square <= inside, 1.0, np.where(chi_square >= outside, 0.0, between))


def settle(
    odometry: Edges,
    loops: Edges,
    inlier: BoolArray,
    inside: BoolArray,
    poses: FloatArray,
    held: IntArray,
    limit: float,
    rounds: int = CHECK_ROUNDS,
) -> Settled:
    """Starts with the given inliers, drops those that the others contradict and admits those that they predict.

    Args:
        odometry: known inliers.
        loops: all closures `(M,)`.
        inlier: those to start with.
        inside: those whose ends are in one group; no other can be checked.
        poses: start, in the groups' frames.
        held: first node of each group.
        limit: squared distance from which a closure is an outlier.
        rounds: of dropping and admitting; with one, closures are checked, and none is admitted.
    """
    rng = np.random.default_rng(len(loops))
    rows = np.flatnonzero(inside)
    system = System.of(odometry + loops.subset(rows), poses, held)
    noise = rng.normal(size=(len(system.edges), len(system.compared), SAMPLES))
    kept, count, locked = inlier[rows].copy(), len(odometry), np.zeros(len(rows), int)
    degrees, converged = degrees_of_true_ones(odometry.T, loops.T), False
    for step in range(rounds):
        used, last = np.concatenate([np.ones(count, bool), kept]), step == rounds - 1
        part = system.subset(used)
        start = poses if converged else cheaper_start(part, poses)
        part, of_part = _starting(part, start, noise[used])
        descent = part.descent(start, np.ones(len(part.edges)), STEPS if last else FEW_STEPS)
        if not (descent.converged or last):  # gross outliers bend it, and hide; at its start they stand out
            at_start = _Check.of(system, part, start, part.spread(Descent(start, False), of_part), noise)
            _, drop, _ = _changes(at_start.distance[count:], kept, locked, limit, degrees)
            if drop.any():
                kept, locked = kept & ~drop, locked + drop
                continue
            descent = part.descent(descent.poses, np.ones(len(part.edges)))
        poses, moved = descent.poses, part.spread(descent, of_part)
        check = _Check.of(system, part, poses, moved, noise)
        of_loops = check.distance[count:]
        bound, drop, admit = _changes(of_loops, kept, locked, limit, degrees)
        if last or not (drop.any() or admit.any()):
            break
        locked += drop
        kept, converged = (kept & ~drop) | admit, not drop.any()  # what bent the estimate may have led it astray
    found, mask = np.full(len(loops), np.nan), np.zeros(len(loops), bool)
    predicted = kept | ((locked < 2) & (rounds > 1))  # where rounds ended early, some are not admitted yet
    found[rows], mask[rows] = of_loops, predicted & (of_loops <= bound)
    used = np.concatenate([np.ones(count, bool), kept])
    components = VarianceComponents.of(check.residuals[used], check.expected[used], degrees)
    redundant = check.distance[used & (check.expected.mean(axis=1) > CHECKED)]
    return Settled(poses, se3.adjoint(poses) @ moved, mask, found, redundant, check.distance[:count], components)


def _changes(
    distance: FloatArray, kept: BoolArray, locked: IntArray, limit: float, degrees: int
) -> tuple[float, BoolArray, BoolArray]:
    """The bound on squared distances, and which closures to drop, the worst first, or else to admit.

    Args:
        distance: `(M,)` squared, of each closure from what the others predict.
        kept: those in the estimate.
        locked: how often each was dropped.
        limit: squared distance from which a closure is an outlier.
        degrees: of freedom.
    """
    bound = fewest_errors(int((distance <= limit).sum()), distance[distance > limit], limit, degrees)
    drop = kept & (distance > bound)
    if drop.any():
        return bound, drop & (distance >= np.where(locked, 1.0, WORST) * distance[drop].max()), np.zeros_like(drop)
    return bound, drop, ~kept & (distance <= bound) & (locked < 2)


def _starting(part: System, poses: FloatArray, noise: FloatArray) -> tuple[System, FloatArray]:
    """`System.starting`, and of noise `(M, D, S)` the components that it compares."""
    flat = part.starting(poses)
    return flat, noise[:, np.searchsorted(part.compared, flat.compared)] if flat is not part else noise


@dataclass(frozen=True, eq=False)
class _Check:
    """Edges against what those in the estimate predict.

    Args:
        residuals: `(M, D)` whitened; zero where an edge leaves the plane that the estimate stays in.
        expected: `(M, D)` variances of these, as sampled.
        distance: `(M,)` squared Mahalanobis distances.
    """

    residuals: FloatArray
    expected: FloatArray
    distance: FloatArray

    @classmethod
    def of(cls, system: System, part: System, poses: FloatArray, moved: FloatArray, noise: FloatArray) -> _Check:
        """By the samples `moved (N, 6, S)` that `noise (M, D, S)` makes of the estimate by a part of the edges."""
        if len(part.free) == len(system.free):
            return cls._alike(system, poses, moved, noise)
        flat = system.staying(poses)
        inside, of_inside = _starting(system.subset(flat), poses, noise[flat])
        outside = system.subset(~flat).moved_as(part)
        within = cls._alike(inside, poses, moved, of_inside)
        residuals, expected = np.zeros((2, len(flat), len(part.free)))
        residuals[flat], expected[flat], distance = within.residuals, within.expected, np.empty(len(flat))
        distance[flat] = within.distance
        distance[~flat] = cls._alike(outside, poses, moved, noise[~flat]).distance
        return cls(residuals, expected, distance)

    @classmethod
    def _alike(cls, system: System, poses: FloatArray, moved: FloatArray, noise: FloatArray) -> _Check:
        (A, B), moved, height = system.jacobians(poses), moved[:, system.free], len(system.compared)
        first, second, covariance = system.edges.first, system.edges.second, np.empty_like(system.W)
        for start in range(0, len(A), EDGES_AT_ONCE):
            rows = slice(start, start + EDGES_AT_ONCE)
            sampled = noise[rows] + A[rows] @ moved[first[rows]] + B[rows] @ moved[second[rows]]
            covariance[rows] = sampled @ np.swapaxes(sampled, 1, 2) / (SAMPLES - height - 1)
        covariance += REDUNDANCY_FLOOR * np.eye(height)
        residuals = system.residuals(poses)
        expected = np.diagonal(covariance, axis1=1, axis2=2)
        return cls(residuals, expected, mahalanobis_squared(residuals, covariance))
