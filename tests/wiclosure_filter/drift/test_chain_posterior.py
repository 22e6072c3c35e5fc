"""The posterior of a chain: its normal equations are those of the density that the steps climb."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure.drift import DriftModel
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.drift.calibration import COUNT, SystematicErrors
from wiclosure.wiclosure_filter.drift.chain_posterior import ChainGuess, ChainPosterior
from wiclosure.wiclosure_filter.drift.error_prior import ErrorPrior
from wiclosure.wiclosure_filter.likelihood.residuals import displacements_in_a


@pytest.mark.parametrize("kind", ["heading", "one-way", "range-only"])
def test_the_gradient_is_that_of_the_density(kind: str, make_case: Callable[..., object]) -> None:
    """With the steps' information held, as the line search does; a little off the truth, where no gradient is zero."""
    case = make_case(kind, drift=DriftModel())
    observations, rng = case.problem.observations, np.random.default_rng(3)
    constant = SystematicErrors.of(observations, case.problem.odometry, ErrorPrior.of(CalibrationPriors()).usual)
    nothing = np.zeros(len(observations)), np.zeros(len(observations))
    posterior = ChainPosterior.of(constant, case.problem.radio, nothing, case.problem.prior, case.problem.odometry)
    w = displacements_in_a(case.state[None], observations)[1][0] + rng.normal(
        0, [0.1, 0.1, 0.0], (len(observations), 3)
    )
    guess = ChainGuess(np.full(len(w), case.state[0] + 0.01), w, np.zeros((1, COUNT)))
    chain, here = posterior.linearised(guess)
    assert here[0] == pytest.approx(posterior.log_density(guess, chain.information)[0], rel=1e-12)

    def density(block: int, number: int, by: float) -> float:
        blocks = np.zeros((len(w), 4))
        blocks[block, number] = by
        return float(posterior.log_density(guess.moved(blocks, np.zeros((1, COUNT))), chain.information)[0])

    for block in (0, len(w) // 2, len(w) - 1):
        for number in range(3):
            slope = (density(block, number, 1e-5) - density(block, number, -1e-5)) / 2e-5
            assert slope == pytest.approx(chain.gradient[block, number], rel=0.02, abs=0.1)
