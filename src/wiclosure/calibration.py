"""Systematic errors that are estimated along with an alignment."""

from __future__ import annotations

import math
from dataclasses import dataclass

_BLUNDER = 10.0  # times the usual size of a constant error


@dataclass(frozen=True, slots=True)
class Calibration:
    """A systematic error that was estimated along with an alignment, and that its predictions are corrected for.

    Args:
        name: what it is.
        unit: `m`, `s`, `rad`, or empty for a ratio.
        value, sigma: the estimate; sigma is that of the prior where the measurements do not tell.
        prior_sigma: standard deviation that was expected.
        held_sigma: that of the Gaussian which stood for the prior: wider where a blunder is likely, or nothing tells.
    """

    name: str
    unit: str
    value: float
    sigma: float
    prior_sigma: float
    held_sigma: float

    @property
    def extraordinary(self) -> bool:
        """Whether it is clearly there, and beyond what is ordinary: a fault."""
        return abs(self.value) > 3 * max(self.sigma, self.prior_sigma)

    @property
    def blunder_sigma(self) -> float:
        """Standard deviation of an error that is a blunder."""
        return _BLUNDER * self.prior_sigma

    @property
    def log_blunder(self) -> float:
        """Natural logarithm of the Bayes factor for an error of a blunder's size, ten times the usual, against that.

        Zero where the prior hardly draws the estimate from what was measured: then the estimate has followed.
        """
        value, sigma = self.measured
        if abs(value - self.value) <= self.sigma:
            return 0.0
        usual, blunder = sigma**2 + self.prior_sigma**2, sigma**2 + self.blunder_sigma**2
        return math.log(usual / blunder) / 2 + value**2 / 2 * (1 / usual - 1 / blunder)

    @property
    def measured(self) -> tuple[float, float]:
        """Value and sigma by the measurements alone, without the prior that draws the estimate to zero."""
        told = max(1.0 - (self.sigma / self.held_sigma) ** 2, 1e-6)
        return self.value / told, self.sigma / math.sqrt(told)

    @property
    def as_blunder(self) -> float:
        """The estimate if the error is of a blunder's size: the measurements then tell nearly all of it."""
        value, sigma = self.measured
        return value / (1 + (sigma / self.blunder_sigma) ** 2)

    @property
    def told(self) -> bool:
        """Whether the measurements tell it at all: better than within ten times its usual size."""
        return self.measured[1] < self.blunder_sigma

    def __str__(self) -> str:
        (value, sigma), unit = self.measured, self.unit
        if not self.told:
            return f"{self.name}: not told by the measurements"
        if unit in {"rad", ""}:
            factor, unit = (180 / math.pi, "degrees") if unit else (100.0, "%")
            value, sigma = factor * value, factor * sigma
        return f"{self.name}: {value:.2f} {unit}, sigma {sigma:.2f}"
