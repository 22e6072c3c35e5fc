"""How far measurements bend odometry and constant errors away from what is usual, and whether one step is to blame.

Measurements that contradict the odometry bend the chain of frame transforms instead of being left unexplained: the sum
of squares of its steps' errors tells, whose expectation is the number of unknowns that the measurements determine.
A *slip* bends one step.  Setting that step free gains as much as a score test says: with the force `f` that holds the
step, its covariance `S`, and a jump that is Gaussian with covariance `J` beforehand, the Bayes factor for a slip is

    f^T J (I + S J)^-1 f / 2 - log det(I + S J) / 2        (natural logarithm).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc, logsumexp  # scipy.stats takes seconds to import

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.drift.bordered_system import BorderedSystem
from wiclosure.wiclosure_filter.drift.calibration import EstimatedErrors

SLIP_ODDS = 0.05  # of a slip, a lifted robot or a restarted odometry while two robots hear each other
UNLIKELY = 100.0  # odds against a time of the slip, beside the likeliest
_JUMP_RAD, _JUMP_M, _JUMP_HEIGHT_M = 0.5, 10.0, 0.3  # how far robots slip, or are carried


@dataclass(frozen=True, eq=False)
class Chain:
    """A chain of M frame transforms, linearised at its optimum.

    Args:
        system: its normal equations.
        error: `(M - 1, 4)` by how much each step is not what odometry tells.
        by_start: `(M - 1, 4, 4)` derivative by the block before; that by the block after is the identity.
        by_errors: `(M - 1, 4, 7)` derivative by the constant errors.
        information: `(M - 1, 4, 4)` of the steps.
        stamp_ns: `(M,)` in order.
    """

    system: BorderedSystem
    error: FloatArray
    by_start: FloatArray
    by_errors: FloatArray
    information: FloatArray
    stamp_ns: IntArray

    def moved(self, blocks: FloatArray, errors: FloatArray) -> Chain:
        """Where the normal equations have their solution: blocks `(M, 4)` and constant errors `(7,)` further.

        There forces are in equilibrium, however early the iterations end: a chain wrong by a hundredth of a step
        would be held by forces that no measurement exerts.
        """
        by_step = np.einsum("mij,mj->mi", self.by_start, blocks[:-1]) + blocks[1:] + self.by_errors @ errors
        return replace(self, error=self.error + by_step)

    @property
    def squared(self) -> float:
        """Sum of squares of the steps' errors, in standard deviations."""
        return float(np.einsum("mi,mij,mj->", self.error, self.information, self.error))

    def covariance(self) -> FloatArray:
        """`(M - 1, 4, 4)` of the steps' errors, with the measurements known."""
        rows = np.arange(len(self.error))
        jacobian = np.zeros((len(rows), 4, len(self.system.inverse)))
        for k in range(4):
            jacobian[rows, :, 4 * rows + k] = self.by_start[:, :, k]
            jacobian[rows, k, 4 * rows + 4 + k] += 1.0
        jacobian[:, :, 4 * len(rows) + 4 :] = self.by_errors
        return np.asarray(jacobian @ self.system.inverse @ np.swapaxes(jacobian, 1, 2))


@dataclass(frozen=True, eq=False)
class Strain:
    """Strain of a chain at its optimum.

    Args:
        squared: sum of squares of the steps' errors and of the constant errors, in standard deviations.
        seldom: the same with constant errors as seldom, see `ErrorPrior.seldom`.
        determined: its expectation.
        slips: `(M - 1,)` natural logarithm of the Bayes factor for a slip at each step.
        stamp_ns: `(M,)` ends of the steps.
    """

    squared: float
    seldom: float
    determined: float
    slips: FloatArray
    stamp_ns: IntArray

    @classmethod
    def of(cls, chain: Chain, errors: EstimatedErrors) -> Strain:
        """Of a chain, and the constant errors that were estimated along with it."""
        force = np.einsum("mij,mj->mi", chain.information, chain.error)
        squared, seldom = (chain.squared + of_errors for of_errors in (errors.squared, errors.seldom))
        open_steps = chain.covariance() @ chain.information
        held = chain.information @ (np.eye(4) - open_steps)
        left_open = np.trace(open_steps, axis1=1, axis2=2).sum()
        left_open += np.sum(np.diag(errors.covariance) / errors.held_sigma**2)
        jump = np.square([_JUMP_RAD, _JUMP_M, _JUMP_M, _JUMP_HEIGHT_M])
        freed = np.eye(4) + held * jump
        gained = np.einsum("mi,mi->m", force * jump, np.linalg.solve(freed, force[..., None])[..., 0])
        slips = (gained - np.linalg.slogdet(freed)[1]) / 2
        determined = chain.error.size + len(errors.value) - left_open
        return cls(squared, seldom, float(determined), slips, chain.stamp_ns)

    def probability(self, inflation: float) -> float:
        """That odometry and errors of their usual size are bent as far; `inflation` is what the steps were granted."""
        return float(chdtrc(max(self.determined, 1.0), inflation**2 * self.squared))

    @property
    def honest_probability(self) -> float:
        """That an honest log bends as far with what the steps were granted, and blunders as often as their prior."""
        return float(chdtrc(max(self.determined, 1.0), self.seldom))

    @property
    def bent_ns(self) -> tuple[int, int] | None:
        """From when to when a slip is likely at all."""
        if len(self.slips) == 0:
            return None
        steps = np.flatnonzero(self.slips >= self.slips.max() - np.log(UNLIKELY))
        return int(self.stamp_ns[steps[0]]), int(self.stamp_ns[steps[-1] + 1])

    def slip(self, min_odds: float) -> str:
        """When the odometry seems to slip, as a sentence; empty where the odds against it are at least `min_odds`."""
        if len(self.slips) == 0:
            return ""
        log_odds = logsumexp(self.slips) - np.log(len(self.slips)) + np.log(SLIP_ODDS)
        if log_odds < -np.log(min_odds):
            return ""
        at = int(np.argmax(self.slips))
        since, until = ((self.stamp_ns[k] - self.stamp_ns[0]) / 1e9 for k in (at, at + 1))
        return (
            "odometry seems to slip, or a robot was moved, or it drifts far more than its model says: the measurements"
            f" bend it most between {since:.0f} s and {until:.0f} s after the first"
        )
