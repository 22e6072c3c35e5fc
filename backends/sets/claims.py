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
COUNTED = 2000  # closures among which neighbours are counted
ROUNDING = 1e-9  # of what is zero


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
        coupled = np.abs(self.covariance[:, IN_PLANE[:, None], OUT_OF_PLANE]).max(initial=0.0)
        if coupled >= ROUNDING or degrees_of_freedom(self.T_A_a, self.T_B_b, self.T_a_b) != len(IN_PLANE):
            return False
        out = sum(np.abs(of_end[:, OUT_OF_PLANE]).max(initial=0.0) for of_end in (self.wander_a, self.wander_b))
        return bool(out + coupled < ROUNDING)

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
        free, (of_a, of_b) = self.free, self.free_of_ends
        both = se3.adjoint(se3.inverse(self.frames))[:, free[:, None], free] @ of_a
        both -= of_b
        both /= np.sqrt(self.samples)
        return np.asarray(both)

    @property
    def free_of_ends(self) -> tuple[FloatArray, FloatArray]:
        """Samples `(N, K, S)` of the errors of the ends' poses."""
        free = self.free
        if len(free) == DEGREES:
            return self.wander_a, self.wander_b
        return self.wander_a[:, free], self.wander_b[:, free]

    @property
    def samples(self) -> int:
        """By which sums over them are divided: the inverse of a sampled covariance is larger."""
        return int(max(self.wander_a.shape[2] - DEGREES - 1, 1))

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
        turn, shift = self._most_variance
        positions, rotations = self.frames[:, :3, 3], self.frames[:, :3, :3].reshape(-1, 9)
        apart = cdist(positions[rows], positions[others], "sqeuclidean")
        angles = np.arccos(np.clip(0.5 * (rotations[rows] @ rotations[others].T - 1.0), -1.0, 1.0))
        return np.asarray(
            (apart <= limit * (shift[rows, None] + shift[others]))
            & (angles**2 <= limit * (turn[rows, None] + turn[others]))
        )

    @cached_property
    def _most_variance(self) -> FloatArray:
        """`(2, N)` of the rotation and the translation of each frame in any direction, from above, twice."""
        parts = self.frame_covariance[:, :3, :3], self.frame_covariance[:, 3:, 3:]
        return 2.0 * np.stack([np.trace(part, axis1=1, axis2=2) for part in parts])

    def _arrays(self) -> tuple[FloatArray, ...]:
        return self.T_A_a, self.T_B_b, self.T_a_b, self.covariance, self.wander_a, self.wander_b
