"""All edges of a team as arrays, and how well each agrees with the first guesses of the poses."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, IntArray

DIGITS_M, DIGITS_RAD = 1e-5, 1e-4  # what six written digits leave of a coordinate (relative) and of a quaternion
FAR_M = 1e3  # coordinates beyond have more digits, or else say nothing of an edge


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """Edges `(E,)` between poses that are numbered from 0.

    Args:
        first, second: numbers of the poses.
        T: `(E, 4, 4)` `T_first_second`.
        covariance: `(E, 6, 6)`.
        may_be_false: whether the file says that it is a loop which may be false.
        misfit: of the guesses, in units of what the written digits leave; infinite where a guess is missing.
        chi_square: of the same, in the stated covariance.
    """

    first: IntArray
    second: IntArray
    T: FloatArray
    covariance: FloatArray
    may_be_false: BoolArray
    misfit: FloatArray
    chi_square: FloatArray

    def __len__(self) -> int:
        return len(self.first)

    def __getitem__(self, rows: IntArray | BoolArray) -> EdgeTable:
        return EdgeTable(
            self.first[rows],
            self.second[rows],
            self.T[rows],
            self.covariance[rows],
            self.may_be_false[rows],
            self.misfit[rows],
            self.chi_square[rows],
        )

    @property
    def exact(self) -> BoolArray:
        """Which edges the guesses were made from: they agree to the last digit."""
        return np.asarray(self.misfit <= 1.0)

    def renumbered(self, number: IntArray) -> EdgeTable:
        """With other numbers of the poses: `number (N,)` has the new one of each."""
        return replace(self, first=number[self.first], second=number[self.second])

    def matrix_kinds(self) -> IntArray:
        """A number `(E,)` for each different matrix that edges state.

        An edge from a later to an earlier pose may state what the others state, seen from its other end.
        """
        both = np.concatenate([self.covariance, se3.inverse_covariance(self.T, self.covariance)])
        stated, turned = np.unique(_leading_digits(both), axis=0, return_inverse=True)[1].reshape(2, -1)
        backward = (self.first > self.second) & np.isin(turned, stated[self.first < self.second])
        return np.asarray(np.where(backward, turned, stated), np.int64)

    def is_step(self) -> BoolArray:
        """Which edges join consecutive poses and are not said to be loops."""
        return np.asarray((np.abs(self.second - self.first) == 1) & ~self.may_be_false)

    def canonical_order(self) -> IntArray:
        """An order of the rows that does not depend on the one in the files."""
        numbers = np.round(self.T[:, :3, 3].T, 9)
        return np.lexsort((*numbers, self.second, self.first))


def _leading_digits(covariance: FloatArray) -> FloatArray:
    """`(E, 36)`, five digits of what is largest in each, which six written ones leave of an inverse."""
    largest = np.abs(covariance).max(axis=(1, 2), initial=0.0)
    unit = 10.0 ** (np.floor(np.log10(np.maximum(largest, 1e-300))) - 4)
    return np.asarray(((covariance / unit[:, None, None]).round() * unit[:, None, None]).round(15).reshape(-1, 36))


def edge_table(
    ends: IntArray, T: FloatArray, covariance: FloatArray, may_be_false: BoolArray, guesses: FloatArray
) -> EdgeTable:
    """The table of edges `(E, 2)` between poses whose guesses `T_world_body (N, 4, 4)` are finite where known."""
    first, second = ends.T
    known = np.asarray(np.isfinite(guesses).all(axis=(1, 2)))[ends].all(axis=1)
    error, chi_square = np.full((len(ends), 6), np.inf), np.full(len(ends), np.inf)
    if known.any():
        predicted = se3.between(guesses[first[known]], guesses[second[known]])
        error[known] = se3.log(se3.between(T[known], predicted))
        whitened = np.linalg.solve(covariance[known], error[known][:, :, None])[:, :, 0]
        chi_square[known] = np.sum(error[known] * whitened, axis=1)
    reach = np.ones(len(ends))
    reach[known] = 1.0 + np.minimum(np.abs(guesses[ends[known]][:, :, :3, 3]).max(axis=(1, 2)), FAR_M)
    angle, distance = (np.linalg.norm(part, axis=1) for part in (error[:, :3], error[:, 3:]))
    misfit = np.maximum(angle / DIGITS_RAD, distance / (DIGITS_M * reach))
    return EdgeTable(first, second, T, covariance, may_be_false, misfit, chi_square)
