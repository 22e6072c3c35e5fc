"""How often unrelated closures agree by chance, told by closures recombined of the same ends and measurements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.edges import DEGREES, mahalanobis_squared
from wiclosure.backends.sets.claims import Claims
from wiclosure.types import FloatArray, IntArray

PAIRS_AT_ONCE = 32  # whose samples are held: they stay in the processor's cache
NULL_PAIRS = 2000  # recombined pairs from which the chance to agree is estimated
DIMENSION_FROM = 20  # of them at least, whose distances say in how many dimensions
DIMENSION_SHARE = 0.02  # of them
NEAREST = 5  # of them, whose distance says how densely chance fills the space around agreement


def chance_distances(claims: Claims, most: int = NULL_PAIRS) -> FloatArray:
    """Sorted squared distances `(M,)` between closures recombined of those given: what unrelated ones would have.

    Ends and measurements are drawn anew and independently, so that places, lengths and directions are those of the
    closures themselves, however few or structured, and no agreement among true ones is left.
    """
    n = len(claims)
    rng = np.random.default_rng(n)  # the same for the same closures
    wanted = min(most, 4 * n**2)  # of few closures there are no more to recombine
    first, first_end, second, second_end = rng.integers(0, n, (4, 3 * wanted))
    unrelated = (first != first_end) & (second != second_end) & (first != second) & (first_end != second_end)
    chosen = np.flatnonzero(unrelated)[:wanted]
    ones, others = (first * n + first_end)[chosen], (second * n + second_end)[chosen]
    made, place = np.unique(np.concatenate([ones, others]), return_inverse=True)  # of few closures, each many times
    return np.sort(Recombined(claims, made // n, made % n).distances(place[: len(chosen)], place[len(chosen) :]))


@dataclass(frozen=True, eq=False)
class Recombined:
    """Closures `(R,)` that nobody measured.

    Args:
        claims: those that they are made of.
        rows: `(R,)` from which they have the first end and the measurement.
        ends: `(R,)` from which they have the second end.
    """

    claims: Claims
    rows: IntArray
    ends: IntArray

    @cached_property
    def frames(self) -> FloatArray:
        """`T_A_B (R, 4, 4)` as each has it."""
        of = self.claims
        return np.asarray(of.T_A_a[self.rows] @ of.T_a_b[self.rows] @ se3.inverse(of.T_B_b[self.ends]))

    def distances(self, one: IntArray, other: IntArray) -> FloatArray:
        """Squared Mahalanobis distances `(P,)` between the frames at `one` and those at `other`."""
        free = self.claims.free
        noise = se3.rotate_covariance(se3.adjoint(self.claims.T_B_b[self.ends]), self.claims.covariance[self.rows])
        noise = noise[:, free[:, None], free]
        covariance = noise[one] + noise[other]
        of_ends = self.claims.free_of_ends
        for start in range(0, len(one), PAIRS_AT_ONCE):
            part = slice(start, start + PAIRS_AT_ONCE)
            apart = self._wander(other[part], of_ends) - self._wander(one[part], of_ends)
            covariance[part] += apart @ np.swapaxes(apart, 1, 2) / self.claims.samples
        error = se3.log(se3.between(self.frames[one], self.frames[other]))[:, free]
        return mahalanobis_squared(error, covariance)

    def _wander(self, made: IntArray, of_ends: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Samples `(P, K, S)` of the errors of some frames by those of the ends."""
        of_a, of_b = of_ends
        return np.asarray(self._to_B[made] @ of_a[self.rows[made]] - of_b[self.ends[made]])

    @cached_property
    def _to_B(self) -> FloatArray:
        free = self.claims.free
        return np.asarray(se3.adjoint(se3.inverse(self.frames))[:, free[:, None], free])


def chance_to_agree(distances: FloatArray, limit: float, closures: int, degrees: int = DEGREES) -> float:
    """Probability that two unrelated closures lie within `limit` of each other.

    The share of recombined pairs that do; where they are too few to count, the share within the distance of the
    nearest ones, scaled down with the volume of the ellipsoid (a nearest-neighbour density estimate).

    Args:
        distances: sorted, from `chance_distances`.
        limit: squared distance.
        closures: how many the recombined ones are made of: pairs are no more independent than these allow.
        degrees: of freedom.
    """
    if not len(distances):
        return 1.0
    independent = min(len(distances), max(1, closures * (closures - 1) // 2))
    nearest = max(1, round(NEAREST * len(distances) / independent)) if independent < len(distances) else NEAREST
    rank = int(np.searchsorted(distances, limit, side="right"))
    nearest = min(nearest, len(distances))
    if rank >= nearest:
        return min(1.0, rank / len(distances))
    near = distances[: round(max(DIMENSION_FROM / independent, DIMENSION_SHARE) * len(distances))]
    exponent = degrees / 2 if independent < 2 * DIMENSION_FROM else min(degrees / 2, _growth(near))
    return float(min(1.0, nearest / len(distances) * (limit / distances[nearest - 1]) ** exponent))


def _growth(distances: FloatArray) -> float:
    """Power of the squared distance with which the number of neighbours grows: half the dimension that they fill.

    Ground robots hardly roll or pitch: unrelated frames fill fewer than six dimensions (Levina and Bickel, NIPS 2004).
    """
    logarithms = np.log(np.maximum(distances, np.finfo(float).tiny))  # closures given twice are no distance apart
    ratios = logarithms[-1] - logarithms[:-1]
    return float(1.0 / max(float(ratios.mean()), 1e-9))
