"""Which closures within groups of robots that are joined already are inliers, and the estimate by them.

Odometry is a known inlier.  Graduated non-convexity (`graduated`) finds the inliers from any start; then each closure
is checked against what all others predict, with the covariance of that prediction: a closure that nothing but odometry
opposes pulls the estimate to itself, and its own residual would not tell.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.stats import f

from wiclosure import se3
from wiclosure.backends.least_squares.chordal import cheaper_start
from wiclosure.backends.least_squares.edges import DEGREES, Edges, degrees_of_true_ones
from wiclosure.backends.least_squares.sampled_estimate import SAMPLES, SampledEstimate, starting
from wiclosure.backends.least_squares.system import FEW_STEPS, STEPS, Descent, System
from wiclosure.backends.least_squares.variance_components import VarianceComponents
from wiclosure.types import BoolArray, FloatArray, IntArray

CHECKED = 0.05  # share of an edge's variance that its residual shows: with less, it tells nothing of sigma
CHECK_ROUNDS = 12
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
        of_odometry: the same, those of odometry alone.
    """

    poses: FloatArray
    wander: FloatArray
    inlier: BoolArray
    distance: FloatArray
    redundant: FloatArray
    strain: FloatArray = field(default_factory=lambda: np.zeros(0))
    components: VarianceComponents = field(default_factory=VarianceComponents.none)
    of_odometry: VarianceComponents = field(default_factory=VarianceComponents.none)

    def scaled(self, scale: float) -> Settled:
        """The same with all standard deviations so many times as large."""
        if scale == 1.0:
            return self
        squared = scale**2
        return replace(
            self,
            wander=scale * self.wander,
            distance=self.distance / squared,
            redundant=self.redundant / squared,
            strain=self.strain / squared,
            components=self.components.scaled(scale),
            of_odometry=self.of_odometry.scaled(scale),
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
    noise = rng.standard_normal(size=(len(system.edges), len(system.compared), SAMPLES))
    kept, count, locked = inlier[rows].copy(), len(odometry), np.zeros(len(rows), int)
    degrees, converged = degrees_of_true_ones(odometry.T, loops.T), False
    for step in range(rounds):
        used, last = np.concatenate([np.ones(count, bool), kept]), step == rounds - 1
        part, of_part = starting(system.subset(used), noise if used.all() else noise[used], poses)
        start, ones = poses if converged else cheaper_start(part, poses), np.ones(len(part.edges))
        descent = part.descent(start, ones, STEPS if last else FEW_STEPS)
        if not (descent.converged or last):  # gross outliers bend it, and hide; at its start they stand out
            at_start = SampledEstimate.of(part, of_part, Descent(start, False)).check(system, noise)
            _, drop, _ = _changes(at_start.distance[count:], kept, locked, limit, degrees)
            if drop.any():
                kept, locked = kept & ~drop, locked + drop
                continue
            descent = part.descent(descent.poses, ones)
        estimate = SampledEstimate.of(part, of_part, descent)
        poses, check = estimate.poses, estimate.check(system, noise)
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
    components, of_odometry = (
        VarianceComponents.of(check.residuals[of], check.expected[of], degrees) for of in (used, slice(count))
    )
    redundant = check.distance[used & (check.expected.mean(axis=1) > CHECKED)]
    moved = se3.adjoint(poses) @ estimate.moved
    return Settled(poses, moved, mask, found, redundant, check.distance[:count], components, of_odometry)


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
