"""Normal equations of a chain of frame transforms, with a border of constant errors: solved in linear time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cholesky_banded, solveh_banded

from wiclosure.types import FloatArray


@dataclass(frozen=True, eq=False)
class BorderedSystem:
    """Symmetric normal equations of M blocks of 4, each coupled with the next, and all with seven systematic errors.

    Args:
        diagonal: `(M, 4, 4)`.
        upper: `(M - 1, 4, 4)` between block m and m + 1.
        border: `(M, 4, 7)` between block m and the errors.
        of_errors: `(7, 7)`.
    """

    diagonal: FloatArray
    upper: FloatArray
    border: FloatArray
    of_errors: FloatArray

    @cached_property
    def inverse(self) -> FloatArray:
        """`(4 M + 7, 4 M + 7)` covariance of the blocks and the errors."""
        alone = np.asarray(solveh_banded(self._bands(), np.eye(len(self._border))))
        follows = np.vstack([-self._response, np.eye(self.of_errors.shape[0])])
        inverse = follows @ self.covariance_of_errors() @ follows.T
        inverse[: len(alone), : len(alone)] += (alone + alone.T) / 2
        return np.asarray(inverse)

    def covariance_of_errors(self) -> FloatArray:
        """`(7, 7)` block of the inverse."""
        return np.asarray(np.linalg.inv(self.of_errors - self._border.T @ self._response))

    @property
    def log_determinant(self) -> float:
        """Natural logarithm of the whole system's determinant."""
        of_blocks = 2 * np.log(cholesky_banded(self._bands())[-1]).sum()
        return float(of_blocks - np.linalg.slogdet(self.covariance_of_errors())[1])

    def marginal(self, block: int) -> FloatArray:
        """`(11, 11)` of the inverse: a block of 4, and the errors."""
        rows = slice(4 * block, 4 * block + 4)
        unit = np.zeros((len(self._border), 4))
        unit[rows] = np.eye(4)
        alone = np.asarray(solveh_banded(self._bands(), unit))[rows]
        follows = np.vstack([-self._response[rows], np.eye(self.of_errors.shape[0])])
        inverse = follows @ self.covariance_of_errors() @ follows.T
        inverse[:4, :4] += (alone + alone.T) / 2
        return np.asarray(inverse)

    @property
    def _border(self) -> FloatArray:
        return self.border.reshape(-1, len(self.of_errors))

    @cached_property
    def _response(self) -> FloatArray:
        """How the blocks follow the errors, with the sign turned."""
        return np.asarray(solveh_banded(self._bands(), self._border))

    def _bands(self) -> FloatArray:
        return banded(self.diagonal, self.upper)


def banded(diagonal: FloatArray, upper: FloatArray) -> FloatArray:
    """`(8, 4 M)` upper bands as scipy wants them: `bands[7 + i - j, j] = H[i, j]`."""
    count = len(diagonal)
    bands = np.zeros((8, 4 * count))
    for i in range(4):
        for j in range(4):
            if i <= j:
                bands[7 + i - j, j::4] = diagonal[:, i, j]
            bands[3 + i - j, 4 + j :: 4] = upper[:, i, j]
    return bands
