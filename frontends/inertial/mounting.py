"""How an IMU is turned in the body, from what it felt: the rotation that explains turning rates and gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from wiclosure.frontends.inertial.gravity import BIAS_SIGMA, LEVER_SIGMA_M, MAD_TO_SIGMA
from wiclosure.frontends.inertial.turning import TurningRates
from wiclosure.frontends.inertial.windows import Windows
from wiclosure.types import FloatArray

OBSERVABLE_RAD = np.radians(3.0)  # at a braking of 2 m/s^2 such an error tilts gravity by 0.6 degrees
STARTS = 8  # turns about the axis that rates leave open
MOST_STEPS = 5000  # of odometry that are used; more tell the same
GYRO_BIAS_SIGMA = 0.05  # rad/s


@dataclass(frozen=True, eq=False)
class Mounting:
    """A rotation that was found.

    Args:
        R_body_imu: `(3, 3)`.
        sigma_rad: `(3,)` about the body's axes.
    """

    R_body_imu: FloatArray
    sigma_rad: FloatArray

    @property
    def observable(self) -> bool:
        """Whether every axis of it is known well enough to be used."""
        return bool((self.sigma_rad <= OBSERVABLE_RAD).all())


def find_mounting(rates: TurningRates, windows: Windows) -> Mounting:
    """The rotation with the least cost over turning rates and changes of gravity between windows.

    Rates of a robot on wheels are all about one axis and leave the turn about it open; braking and curves then tell it,
    because specific force minus the odometry's acceleration must not change.  Gyroscope and accelerometer bias and the
    lever arm are estimated along.

    Args:
        rates: of odometry and gyroscope over the same steps.
        windows: along the same odometry, two at least.
    """
    problem = _Problem.of(rates, windows)
    first = _by_rates(rates)
    axis = _main_axis(rates)
    turns = [Rotation.from_rotvec(2 * np.pi * n / STARTS * axis).as_matrix() for n in range(STARTS)]
    costs = [problem.cost_of(turn @ first) for turn in turns]
    tried = [turns[n] @ first for n in np.argsort(costs)[:3]]
    best = min((problem.solved(R) for R in tried), key=lambda found: found[0])
    return Mounting(best[1], best[2])


@dataclass(frozen=True, eq=False)
class _Problem:
    """Whitened residuals of a rotation and the nuisances: gyroscope bias, accelerometer bias, lever arm."""

    rates: TurningRates
    force: FloatArray
    acceleration: FloatArray
    nuisance: FloatArray
    sigma_rate: float
    sigma_force: float

    @classmethod
    def of(cls, rates: TurningRates, windows: Windows) -> _Problem:
        """Noise as it scatters about the best rotation by rates alone."""
        rows = np.unique(np.linspace(0, len(rates) - 1, min(len(rates), MOST_STEPS)).astype(int))
        rates = TurningRates(rates.odometry[rows], rates.imu[rows], rates.seconds[rows], rates.step[rows])
        R = _by_rates(rates)
        off = rates.odometry - rates.imu @ R.T
        sigma_rate = MAD_TO_SIGMA * float(np.median(np.abs(off - np.median(off, axis=0)))) + 1e-4
        nuisance = np.concatenate([windows.bias, windows.lever], axis=2)
        force, acceleration, nuisance = (np.diff(of, axis=0) for of in (windows.force, windows.acceleration, nuisance))
        return cls(rates, force, acceleration, nuisance, sigma_rate, sigma_force=1.0)

    def _changes(self, R: FloatArray, nuisance: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("wijk,jk->wi", self.force, R) - self.acceleration - self.nuisance @ nuisance)

    def residuals(self, x: FloatArray, start: FloatArray) -> FloatArray:
        """Of rotation vector, gyroscope bias, accelerometer bias and lever arm `(12,)`."""
        R = Rotation.from_rotvec(x[:3]).as_matrix() @ start
        off = (self.rates.odometry - self.rates.imu @ R.T + x[3:6]) / self.sigma_rate
        priors = x[3:] / np.repeat([GYRO_BIAS_SIGMA, BIAS_SIGMA, LEVER_SIGMA_M], 3)
        return np.concatenate([off.ravel(), self._changes(R, x[6:]).ravel() / self.sigma_force, priors])

    def cost_of(self, R: FloatArray) -> float:
        """Of the windows: rates cost the same at every start."""
        return float(np.sum(np.log1p(self._changes(R, np.zeros(6)) ** 2)))

    def solved(self, start: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Cost, rotation, and its standard deviations; twice, the second time with the noise that the first left."""
        x, problem = np.zeros(12), self
        for _ in range(2):
            found = least_squares(problem.residuals, x, args=(start,), loss="cauchy")
            x = found.x
            R = Rotation.from_rotvec(x[:3]).as_matrix() @ start
            left = MAD_TO_SIGMA * float(np.median(np.abs(self._changes(R, x[6:])))) + 1e-3
            problem = _Problem(
                self.rates, self.force, self.acceleration, self.nuisance, self.sigma_rate, sigma_force=left
            )
        sigma_rad = _sigmas(np.asarray(found.jac), len(self.rates) + len(self.force))
        scatter = float(np.sum(np.log1p(self._changes(R, x[6:]) ** 2)))
        return scatter, R, sigma_rad


def _sigmas(J: FloatArray, vectors: int) -> FloatArray:
    """Standard deviations `(3,)` of the rotation, rad, nuisances taken out; infinite where it is not observable.

    Vectors that are nothing but noise seem to tell a rotation, each with an information of 2 about every axis: the
    noise is in what is turned.  So much is taken off.
    """
    information = J.T @ J
    nuisance = information[:3, 3:] @ np.linalg.solve(information[3:, 3:], information[3:, :3])
    told = information[:3, :3] - nuisance - 2.0 * vectors * np.eye(3)
    if np.linalg.eigvalsh(told)[0] <= 0.0:
        return np.full(3, np.inf)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(told))))


def _by_rates(rates: TurningRates) -> FloatArray:
    """`R_body_imu` by Wahba's problem over the rates (Kabsch 1976)."""
    U, _, Vt = np.linalg.svd(rates.odometry.T @ rates.imu)
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def _main_axis(rates: TurningRates) -> FloatArray:
    """The axis `(3,)` in the body that it turns about most."""
    return np.asarray(np.linalg.eigh(rates.odometry.T @ rates.odometry)[1][:, -1])
