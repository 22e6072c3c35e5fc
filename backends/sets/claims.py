"""What closures between two groups of robots claim of one thing: where the second group's frame lies in the first's."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial.distance import cdist

from wiclosure import se3
from wiclosure.backends.least_squares.edges import (
    DEGREES,
    degrees_of_freedom,
    degrees_of_true_ones,
    mahalanobis_squared,
)
from wiclosure.backends.least_squares.system import IN_PLANE, OUT_OF_PLANE
from wiclosure.types import BoolArray, FloatArray, IntArray

PAIRS_AT_ONCE = 65536  # pairs at once: bounds memory
SAMPLED_AT_ONCE = 4096  # likewise, of those whose samples are held
COUNTED = 2000  # closures among which neighbours are counted
NULL_PAIRS = 2000  # recombined pairs from which the chance to agree is estimated
DIMENSION_FROM = 20  # of them at least, whose distances say in how many dimensions
DIMENSION_SHARE = 0.02  # of them
ROUNDING = 1e-9  # of what is zero
NEAREST = 5  # of them, whose distance says how densely chance fills the space around agreement


@dataclass(frozen=True, eq=False)
class Claims:
    """N closures from group A to group B, each as a measurement of `T_A_B`.

    Args:
        T_A_a, T_B_b: `(N, 4, 4)` estimated poses of the closures' ends in their groups' frames.
        T_a_b: `(N, 4, 4)` the measurements.
        covariance: `(N, 6, 6)` of them, as errors in b's body.
        wander_a, wander_b: `(N, 6, S)` samples of the errors of the ends' estimated poses, as tangent vectors in the
            groups' frames.
        known_flat: what `flat` is, where it is known.
    """

    T_A_a: FloatArray
    T_B_b: FloatArray
    T_a_b: FloatArray
    covariance: FloatArray
    wander_a: FloatArray
    wander_b: FloatArray
    known_flat: bool | None = field(default=None, kw_only=True)

    def __len__(self) -> int:
        return len(self.T_a_b)

    def subset(self, rows: IntArray) -> Claims:
        """The closures at `rows`."""
        return Claims(*(a[rows] for a in self._arrays()))

    def recombined(self, rows: IntArray, others: IntArray) -> Claims:
        """Closures that nobody measured: first end and measurement of `rows (M,)`, second end of `others (M,)`."""
        measured = self.T_a_b[rows], self.covariance[rows]
        ends = self.wander_a[rows], self.wander_b[others]
        return Claims(self.T_A_a[rows], self.T_B_b[others], *measured, *ends, known_flat=self.flat or None)

    @cached_property
    def frames(self) -> FloatArray:
        """`T_A_B (N, 4, 4)` as each closure has it."""
        return np.asarray(self.T_A_a @ self.T_a_b @ se3.inverse(self.T_B_b))

    @cached_property
    def degrees(self) -> int:
        """Of freedom of the differences between true frames."""
        return degrees_of_true_ones(self.frames[:0], self.frames)

    @cached_property
    def flat(self) -> bool:
        """Whether ends and measurements stay in the plane, and errors there are independent of those out of it."""
        if self.known_flat is not None:
            return self.known_flat
        ends, coupled = (self.wander_a, self.wander_b), self.covariance[:, IN_PLANE[:, None], OUT_OF_PLANE]
        out = sum(float(np.abs(of_end[:, OUT_OF_PLANE]).max(initial=0.0)) for of_end in ends)
        apart = out + float(np.abs(coupled).max(initial=0.0)) < ROUNDING
        return apart and degrees_of_freedom(self.T_A_a, self.T_B_b, self.T_a_b) == len(IN_PLANE)

    @property
    def free(self) -> IntArray:
        """Components `(K,)` that frames differ in: three in the plane."""
        return IN_PLANE if self.flat else np.arange(DEGREES)

    @cached_property
    def noise(self) -> FloatArray:
        """Covariance `(N, 6, 6)` of `frames` by the measurements alone, as errors in B."""
        return se3.rotate_covariance(se3.adjoint(self.T_B_b), self.covariance)

    @cached_property
    def free_wander(self) -> FloatArray:
        """Samples `(N, K, S)` of the errors of `frames` by the ends' poses, as errors in B; scaled to covariance."""
        free, samples = self.free, self.wander_a.shape[2]
        to_B = se3.adjoint(se3.inverse(self.frames))[:, free[:, None], free]
        both = to_B @ self.wander_a[:, free] - self.wander_b[:, free]
        return np.asarray(
            both / np.sqrt(max(samples - DEGREES - 1, 1))
        )  # the inverse of a sampled covariance is larger

    @property
    def wander(self) -> FloatArray:
        """The same `(N, 6, S)` of all components."""
        return self.wander_at(np.arange(len(self)))

    def wander_at(self, rows: IntArray) -> FloatArray:
        """The same `(R, 6, S)` of some closures."""
        samples = np.zeros((len(rows), DEGREES, self.wander_a.shape[2]))
        samples[:, self.free] = self.free_wander[rows]
        return samples

    @cached_property
    def frame_covariance(self) -> FloatArray:
        """Covariance `(N, 6, 6)` of each frame by itself, as errors in B."""
        covariance, free = self.noise.copy(), self.free
        covariance[:, free[:, None], free] += self.free_wander @ np.swapaxes(self.free_wander, 1, 2)
        return covariance

    def mean_frame(self, rows: IntArray, near: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`T_A_B` by the closures at `rows` together, each weighted by its own information.

        Args:
            rows: closures that agree.
            near: one of them: its frame is where the others are linearised.

        Returns:
            The frame `(4, 4)`, and of its error in B the covariance `(6, 6)` by the measurements and the samples
            `(6, S)` by the ends' poses, which the closures share.
        """
        noise, wander = self.noise[rows], self.wander_at(rows)
        information = np.linalg.inv(self.frame_covariance[rows])
        gain = np.linalg.solve(information.sum(axis=0), information)
        apart = se3.log(se3.between(self.frames[near], self.frames[rows]))
        frame = self.frames[near] @ se3.exp(np.einsum("nij,nj->i", gain, apart))
        return frame, np.einsum("nij,njk,nlk->il", gain, noise, gain), np.einsum("nij,njs->is", gain, wander)

    def distances(self, rows: IntArray, beyond: float, others: IntArray | None = None) -> FloatArray:
        """Squared Mahalanobis distances `(R, K)` between the frames of `rows` and those of `others`, or of all.

        Infinite where rotations or translations alone are further apart than `beyond` allows: seen at little cost.
        """
        others = np.arange(len(self)) if others is None else others
        found = np.full((len(rows), len(others)), np.inf)
        size, width, samples = max(1, PAIRS_AT_ONCE // max(len(others), 1)), len(self.free), self.wander_a.shape[2]
        wander, covariances = self.free_wander, self.frame_covariance[:, self.free[:, None], self.free]
        by_sample = wander[others].reshape(-1, samples).T
        for start in range(0, len(rows), size):
            part = rows[start : start + size]
            first, second = np.nonzero(self._may_agree(part, others, beyond))
            one, other = part[first], others[second]
            products = wander[part].reshape(-1, samples) @ by_sample  # one large product: faster than many small
            cross = products.reshape(len(part), width, len(others), width)[first, :, second]
            covariance = covariances[one] + covariances[other] - cross - np.swapaxes(cross, 1, 2)
            error = se3.log(se3.between(self.frames[one], self.frames[other]))[:, self.free]
            found[start + first, second] = mahalanobis_squared(error, covariance)
        found[rows[:, None] == others] = 0.0
        return found

    def pair_distances(self, one: IntArray, other: IntArray) -> FloatArray:
        """Squared Mahalanobis distances `(P,)` between the frames at `one` and those at `other`."""
        found, free = np.empty(len(one)), self.free
        noise = self.noise[:, free[:, None], free]
        for start in range(0, len(one), SAMPLED_AT_ONCE):
            i, j = one[start : start + SAMPLED_AT_ONCE], other[start : start + SAMPLED_AT_ONCE]
            apart = self.free_wander[j] - self.free_wander[i]
            covariance = noise[i] + noise[j] + apart @ np.swapaxes(apart, 1, 2)
            error = se3.log(se3.between(self.frames[i], self.frames[j]))[:, free]
            found[start : start + SAMPLED_AT_ONCE] = mahalanobis_squared(error, covariance)
        return found

    def neighbours(self, limit: float) -> IntArray:
        """`(N,)` how many closures may lie within a squared distance of `limit`: bounded from above, at little cost."""
        counted = np.unique(np.linspace(0, len(self) - 1, min(COUNTED, len(self))).round().astype(np.int64))
        found = np.zeros(len(self), np.int64)
        size = max(1, PAIRS_AT_ONCE // max(len(counted), 1))
        for start in range(0, len(self), size):
            part = np.arange(start, min(start + size, len(self)))
            found[part] = self._may_agree(part, counted, limit).sum(axis=1)
        return found

    def _may_agree(self, rows: IntArray, others: IntArray, limit: float) -> BoolArray:
        """`(R, K)` False where a squared distance certainly exceeds `limit`.

        It is at least the square of the rotation's part of the error by the largest variance of it, so by their sum; of
        the translation's part likewise, which is no shorter than the distance of the frames.  The covariance of a
        difference is at most twice the sum of both.
        """
        turn, shift = (
            2.0 * np.trace(self.frame_covariance[:, part, part], axis1=1, axis2=2) for part in (slice(3), slice(3, 6))
        )
        positions, rotations = self.frames[:, :3, 3], self.frames[:, :3, :3].reshape(-1, 9)
        apart = cdist(positions[rows], positions[others], "sqeuclidean")
        angles = np.arccos(np.clip(0.5 * (rotations[rows] @ rotations[others].T - 1.0), -1.0, 1.0))
        return np.asarray(
            (apart <= limit * (shift[rows, None] + shift[others]))
            & (angles**2 <= limit * (turn[rows, None] + turn[others]))
        )

    def chance_distances(self, most: int = NULL_PAIRS) -> FloatArray:
        """Sorted squared distances `(M,)` between closures recombined of those given: what unrelated ones would have.

        Ends and measurements are drawn anew and independently, so that places, lengths and directions are those of the
        closures themselves, however few or structured, and no agreement among true ones is left.
        """
        n = len(self)
        rng = np.random.default_rng(n)  # the same for the same closures
        wanted = min(most, 4 * n**2)  # of few closures there are no more to recombine
        first, first_end, second, second_end = rng.integers(0, n, (4, 3 * wanted))
        unrelated = (first != first_end) & (second != second_end) & (first != second) & (first_end != second_end)
        chosen = np.flatnonzero(unrelated)[:wanted]
        ones, others = (first * n + first_end)[chosen], (second * n + second_end)[chosen]
        made, place = np.unique(np.concatenate([ones, others]), return_inverse=True)  # of few closures, each many times
        unrelated, one, other = self.recombined(made // n, made % n), place[: len(chosen)], place[len(chosen) :]
        return np.sort(unrelated.pair_distances(one, other))

    def _arrays(self) -> tuple[FloatArray, ...]:
        return self.T_A_a, self.T_B_b, self.T_a_b, self.covariance, self.wander_a, self.wander_b


def chance_to_agree(distances: FloatArray, limit: float, closures: int, degrees: int = DEGREES) -> float:
    """Probability that two unrelated closures lie within `limit` of each other.

    The share of recombined pairs that do; where they are too few to count, the share within the distance of the
    nearest ones, scaled down with the volume of the ellipsoid (a nearest-neighbour density estimate).

    Args:
        distances: sorted, from `Claims.chance_distances`.
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
