"""How many times too small, or too large, the stated standard deviations are.

Told by what is known to be right: within robots by their odometry and their own loops, whose residuals have a known
distribution; without such loops by the scale at which sets of closures between robots are least likely by chance.
Closures recombined of the same ends and measurements agree more as well when sigma is taken larger, so that a scale
under which anything agrees explains nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from wiclosure.backends.sets.alignment import ClosureComparison
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE
from wiclosure.types import FloatArray

QUANTILES = np.array([0.5, 0.75, 0.9, 0.95])  # of residuals, the most demanding of which counts: tails may be heavy
FAR_APART = 3.0  # times; those of one distribution, 20 of them, stay within it in 99 of 100 cases
ENOUGH = 20  # residuals from which a scale is taken
NO_MATTER = 1.5  # factors nearer to 1 change no decision that the data could settle
STEP = np.sqrt(2.0)
ROOM = 4.0  # times the factor of a set, from where the residuals of the estimate lead down again
SHRINKS = 3  # times as far, on a logarithmic scale, as it grows: smaller sigmas let nothing false agree


def of_residuals(distances: FloatArray, degrees: int = 6) -> float | None:
    """Factor by which squared distances `(K,)` ask for; None if they are too few."""
    if len(distances) < ENOUGH:
        return None
    return float(np.sqrt(np.max(np.quantile(distances, QUANTILES) / chi2.ppf(QUANTILES, degrees))))


def of_most(distances: FloatArray, degrees: int) -> float:
    """Factor that the median of squared distances `(K,)` asks for: larger ones may be of what does not belong."""
    return float(np.sqrt(np.median(distances) / chi2.ppf(0.5, degrees)))


def far_apart(distances: FloatArray, degrees: int) -> bool:
    """Whether the smallest ask for a much smaller factor than the largest, as where some are of false loops."""
    of_largest = of_residuals(distances, degrees)
    of_smallest = np.sqrt(np.quantile(distances, 0.1) / chi2.ppf(0.1, degrees)) if len(distances) else 0.0
    return of_largest is not None and of_largest > FAR_APART * of_smallest


def of_sets(comparisons: Sequence[ClosureComparison], limit: float, most: float) -> float:
    """The factor, from `least(most)` to `most`, that makes the sets found between robots least likely by chance.

    Then the pairs within these sets tell the factor as residuals do.
    """
    steps = int(np.log(most) / np.log(STEP) + 1e-9)
    scales = STEP ** np.arange(-SHRINKS * steps, steps + 1)
    evidence = [sum(_evidence(comparison, limit * scale**2) for comparison in comparisons) for scale in scales]
    if max(evidence) <= 0:
        return 1.0
    rough = float(scales[int(np.argmax(evidence))])
    rare = np.log(EXPECTED_BY_CHANCE / len(scales))  # one of so many scales fits random closures best
    inside = np.concatenate(
        [_inside(comparison, limit * rough**2, limit * (2.0 * rough) ** 2, rare) for comparison in comparisons]
    )
    fine = of_residuals(inside, comparisons[0].claims.degrees)
    if fine is None:
        found = rough if max(evidence) >= -rare and rough < 1.0 else 1.0
    else:
        found = float(np.clip(fine, rough / 2.0, rough * 2.0))
    if found >= 1.0 / NO_MATTER:
        return found
    # Who agrees least may be outside the set: below what is stated there is room to let the estimate tell.
    rarer = (scales <= ROOM * found) & (scales >= found) & (np.array(evidence) >= -rare)
    return float(np.max(scales[rarer], initial=found))


def settled(scale: float, least: float, most: float) -> float:
    """Within what is allowed; 1 where it is near 1."""
    if 1.0 / NO_MATTER <= scale <= NO_MATTER:
        return 1.0
    return float(np.clip(scale, least, most))


def least(most: float) -> float:
    """The smallest factor: edges without information are read as if they were known to a metre and a radian."""
    return most**-SHRINKS


def _evidence(comparison: ClosureComparison, limit: float) -> float:
    consistent_sets = comparison.consistent_sets(limit, most=1)
    return max(0.0, -consistent_sets[0].log_chance) if consistent_sets else 0.0


def _inside(comparison: ClosureComparison, limit: float, wide: float, rare: float) -> FloatArray:
    """Squared distances between the closures of the largest set, each pair once, if chance does not explain it."""
    consistent_sets = comparison.consistent_sets(limit, most=1)
    if not consistent_sets or consistent_sets[0].log_chance > rare:
        return np.zeros(0)
    consistent_sets = comparison.consistent_sets(wide, most=1)
    rows = np.flatnonzero(np.isin(comparison.anchors, consistent_sets[0].rows))
    square = comparison.between_anchors[np.ix_(rows, rows)]
    return np.asarray(square[np.triu_indices(len(rows), 1)])
