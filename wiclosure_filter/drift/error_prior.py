"""What is known of constant errors beforehand: usually small, and in a few logs ten times as large.

A Gaussian alone would hold an error of ten standard deviations near zero against all that was measured, and would
vouch for an error that nothing tells.  The prior is a mixture of two.  For normal equations, each error gets the
Gaussian about zero under which its posterior is as wide as under the mixture (expectation propagation, Minka 2001):
close to the usual one where the measurements agree with that, wide where they tell a blunder, and with the mixture's
own spread where they tell nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri  # scipy.stats takes seconds to import

from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.config import CalibrationPriors

BLUNDER_TIMES = 10.0  # size of a blunder, in usual errors


@dataclass(frozen=True, eq=False)
class ErrorPrior:
    """Prior of the seven errors.

    Args:
        usual: `(7,)` standard deviations.
        blunder_share: of logs, in which an error is `BLUNDER_TIMES` as large.
    """

    usual: FloatArray
    blunder_share: float

    @classmethod
    def of(cls, priors: CalibrationPriors) -> ErrorPrior:
        """As it is set."""
        sigma = [priors.range_bias_m, priors.range_scale, priors.clock_s, priors.mounting_rad, priors.mounting_rad]
        return cls(np.array([*sigma, priors.scale, priors.scale]), priors.blunder_share)

    def squared(self, value: FloatArray) -> float:
        """Minus twice the natural logarithm of the density of errors `(7,)` over that at zero, summed."""
        off = (value / self.usual) ** 2
        odds = self._odds / BLUNDER_TIMES  # at zero
        density = np.logaddexp(-off / 2, np.log(odds) - off / BLUNDER_TIMES**2 / 2) - np.log1p(odds)
        return max(float(-2 * density.sum()), 0.0)

    def seldom(self, value: FloatArray) -> float:
        """Sum of squares of errors `(7,)` of a standard normal distribution that are as seldom.

        Of chi-square distribution if errors are as the prior has them, which a density is not: one of a log's seven
        errors is a blunder more often than a Gaussian of usual errors exceeds three standard deviations.
        """
        size = np.abs(value) / self.usual
        beyond = (1 - self.blunder_share) * ndtr(-size) + self.blunder_share * ndtr(-size / BLUNDER_TIMES)
        return float(np.sum(ndtri(np.maximum(beyond, 1e-300)) ** 2))

    @property
    def _odds(self) -> float:
        """Of a blunder against a usual error."""
        return max(self.blunder_share, 1e-300) / (1 - self.blunder_share)

    def held(self, value: FloatArray, sigma: FloatArray, held: FloatArray) -> FloatArray:
        """`(..., 7)` standard deviations of the Gaussians that stand for the prior.

        Args:
            value: `(..., 7)` estimates.
            sigma: `(..., 7)` of these.
            held: `(..., 7)` under which they were estimated.
        """
        told = np.maximum(1 - (sigma / held) ** 2, 1e-6)
        value, variance = value / told, sigma**2 / told  # by the measurements alone
        prior = np.stack([np.broadcast_to(times * self.usual, value.shape) for times in (1.0, BLUNDER_TIMES)]) ** 2
        log_evidence = -np.log(prior + variance) / 2 - value**2 / (prior + variance) / 2
        odds = self._odds * np.exp(np.minimum(log_evidence[1] - log_evidence[0], 300.0))
        share = np.stack([1 / (1 + odds), odds / (1 + odds)])
        each = prior * variance / (prior + variance)
        mean = value * each / variance
        spread = np.sum(share * (each + mean**2), axis=0) - np.sum(share * mean, axis=0) ** 2
        information = np.maximum(1 / spread - 1 / variance, prior[1] ** -1)
        return np.asarray(np.minimum(information, prior[0] ** -1) ** -0.5)
