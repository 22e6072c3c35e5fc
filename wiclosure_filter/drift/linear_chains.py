"""Normal equations of many chains of frame transforms at once, one after the other.

Chains are short: what each costs by itself is the calls, not the numbers.  No step leads from one chain to the next, so
that one banded system solves them all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solveh_banded

from wiclosure.types import BoolArray, FloatArray, IntArray
from wiclosure.wiclosure_filter.drift.bordered_system import BorderedSystem, banded
from wiclosure.wiclosure_filter.drift.strain import Chain


@dataclass(frozen=True, eq=False)
class Segments:
    """Which of T measurements belong to each of B chains.

    Args:
        ends: `(B + 1,)` where each chain begins, and T.
    """

    ends: IntArray

    @classmethod
    def of(cls, lengths: Sequence[int]) -> Segments:
        """Of chains of so many measurements, one at least."""
        return cls(np.concatenate([[0], np.cumsum(lengths)]))

    @cached_property
    def chain(self) -> IntArray:
        """`(T,)` of each measurement."""
        return np.repeat(np.arange(len(self.lengths)), self.lengths)

    @property
    def lengths(self) -> IntArray:
        """`(B,)`."""
        return np.diff(self.ends)

    @cached_property
    def within(self) -> BoolArray:
        """`(T - 1,)` which steps from a measurement to the next stay in a chain."""
        return np.asarray(self.chain[:-1] == self.chain[1:])

    def sums(self, values: FloatArray) -> FloatArray:
        """`(B, ...)` of `(T, ...)`, or of `(T - 1, ...)` that are 0 between chains."""
        if len(values) < self.ends[-1]:
            values = np.concatenate([values, np.zeros((1, *values.shape[1:]))])
        return np.add.reduceat(values, self.ends[:-1], axis=0)

    def largest(self, values: FloatArray) -> FloatArray:
        """`(B,)` largest of the numbers `(T, n)` of each chain."""
        return np.asarray(np.maximum.reduceat(values, self.ends[:-1], axis=0).max(axis=1))


@dataclass(frozen=True, eq=False)
class LinearChains:
    """B chains of T frame transforms together, linearised; see `BorderedSystem` and `Chain`.

    Args:
        segments: the chains.
        diagonal: `(T, 4, 4)`.
        upper: `(T - 1, 4, 4)`, 0 between chains.
        gradient: `(T, 4)`.
        border: `(T, 4, 7)`.
        of_errors: `(B, 7, 7)`.
        gradient_of_errors: `(B, 7)`.
        error, by_start, by_errors, information: of the steps, with leading dimension `T - 1`.
        stamp_ns: `(T,)`.
    """

    segments: Segments
    diagonal: FloatArray
    upper: FloatArray
    gradient: FloatArray
    border: FloatArray
    of_errors: FloatArray
    gradient_of_errors: FloatArray
    error: FloatArray
    by_start: FloatArray
    by_errors: FloatArray
    information: FloatArray
    stamp_ns: IntArray

    def solved(self) -> tuple[FloatArray, FloatArray]:
        """Solution `(T, 4)` of the blocks, and that of the errors `(B, 7)`."""
        left = self.gradient_of_errors - self._pulled[..., 0]
        errors = (self.covariance_of_errors @ left[..., None])[..., 0]
        alone, response = self._solutions[..., 0], self._solutions[..., 1:]
        return alone - (response @ errors[self.segments.chain][..., None])[..., 0], errors

    @cached_property
    def covariance_of_errors(self) -> FloatArray:
        """`(B, 7, 7)`."""
        return np.asarray(np.linalg.inv(self.of_errors - self._pulled[..., 1:]))

    @cached_property
    def _solutions(self) -> FloatArray:
        """`(T, 4, 8)` of the blocks without errors, and how they follow these, with the sign turned."""
        blocks = self.gradient.size
        right = np.column_stack([self.gradient.reshape(-1), self.border.reshape(blocks, -1)])
        return np.asarray(solveh_banded(banded(self.diagonal, self.upper), right)).reshape(-1, 4, right.shape[1])

    @cached_property
    def _pulled(self) -> FloatArray:
        """`(B, 7, 8)` what both do to the errors."""
        return self.segments.sums(np.swapaxes(self.border, 1, 2) @ self._solutions)

    def chain(self, number: int) -> Chain:
        """One of them."""
        first, end = self.segments.ends[number], self.segments.ends[number + 1]
        blocks, steps = slice(first, end), slice(first, end - 1)
        system = BorderedSystem(self.diagonal[blocks], self.upper[steps], self.border[blocks], self.of_errors[number])
        return Chain(
            system,
            self.error[steps],
            self.by_start[steps],
            self.by_errors[steps],
            self.information[steps],
            self.stamp_ns[blocks],
        )
