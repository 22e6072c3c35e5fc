"""Which way is up along a robot's odometry, with the accelerometer's bias found along."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation
from scipy.stats import f

from wiclosure.frontends.inertial.windows import Windows
from wiclosure.types import BoolArray, FloatArray, Trajectory, UpDirections

STANDARD_GRAVITY = 9.81  # m/s^2; 9.78 at the equator, 9.83 at the poles
GRAVITY_SPREAD = 0.03  # m/s^2, by latitude and height
BIAS_SIGMA = 0.05  # m/s^2 an axis: an ordinary accelerometer after its factory calibration
LEVER_SIGMA_M = 0.5  # of an IMU whose place is not told
KNOWN_LEVER_SIGMA_M = 0.02
LENGTH_SIGMAS = 4.0  # beyond, a window's length is not that of gravity
ASIDE_SIGMAS = 8.0  # beyond, it points elsewhere than all others: an accelerometer that stuck, or was pushed
BY_CHANCE = 0.01  # so rarely, sound windows count as scattering too far
ROUNDS = 5  # of reweighting
CAUCHY_WIDTH = 2.3849  # 95 % efficiency on Gaussian errors
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, eq=False)
class GravityFit:
    """Gravity in W windows, bias and lever arm taken out.

    Args:
        windows: what it was found from.
        vectors: `(W, 3)` against gravity in the odometry frame, m/s^2, each from its own window alone.
        smoothed: `(W, 3)` the same as all windows and the odometry's drift have it together.
        noise: standard deviation of the vectors' components, m/s^2, as they scatter.
        bias: `(3,)` of the accelerometer in the body's axes, m/s^2.
        bias_covariance: `(3, 3)`.
        good: `(W,)` whose length is that of gravity, and whose direction is not far from the others'.
        excess: Birge's ratio (1932), at least 1: how far the good ones lie from what all have together, against noise;
            a bias that wanders, or axes of unlike scale, are not in the model, and widen what it says of itself.
    """

    windows: Windows
    vectors: FloatArray
    smoothed: FloatArray
    noise: float
    bias: FloatArray
    bias_covariance: FloatArray
    good: BoolArray
    excess: float = 1.0

    @property
    def length(self) -> float:
        """Median length of the vectors, m/s^2."""
        return float(np.median(np.linalg.norm(self.vectors, axis=1)))

    @property
    def sigma_rad(self) -> float:
        """Of each window's direction, were they independent of each other.

        What is left of the bias is the same error in all: so many measurements average to it, not to less.
        """
        up_body = np.einsum("wji,wj->wi", self.windows.bias, self.smoothed)
        up_body /= np.linalg.norm(up_body, axis=1)[:, None]
        along = np.einsum("wi,ij,wj->w", up_body, self.bias_covariance, up_body)
        across = float(np.mean(np.trace(self.bias_covariance) - along)) / 2.0
        return float(self.excess * np.sqrt(self.noise**2 + max(int(self.good.sum()), 1) * across) / STANDARD_GRAVITY)

    @property
    def R_level_odom(self) -> FloatArray:
        """`(3, 3)` the smallest turn after which z of the odometry frame points up, over the whole path."""
        up = np.mean(self.smoothed[self.good] if self.good.any() else self.smoothed, axis=0)
        return level_rotation(up)


def level_rotation(up: FloatArray) -> FloatArray:
    """The smallest rotation `(3, 3)` that turns a vector `(3,)` to z."""
    up = up / np.linalg.norm(up)
    axis = np.cross(up, np.array([0.0, 0.0, 1.0]))
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3) if up[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return np.asarray(Rotation.from_rotvec(axis / sine * np.arctan2(sine, up[2])).as_matrix())


def fit_gravity(
    windows: Windows, odometry: Trajectory, R_body_imu: FloatArray, lever_m: FloatArray | None = None
) -> GravityFit:
    """Gravity in every window, and one bias, by weighted least squares under a Cauchy kernel.

    Gravity stands still but for the drift of the odometry's attitude, while a bias turns with the body: where the robot
    turns, they are told apart; where it does not, the bias keeps its prior, and `sigma_rad` says so.

    Args:
        windows: at least three.
        odometry: whose drift model says how far gravity may turn from window to window.
        R_body_imu: `(3, 3)` mounting.
        lever_m: `(3,)` the IMU's place in the body, or None where it is not known.
    """
    system = _System.of(windows, odometry, R_body_imu, lever_m)
    shared, noise = system.prior_mean, system.scatter(system.prior_mean)
    weights = np.ones(len(windows))
    for _ in range(ROUNDS):
        shared, smoothed, covariance = system.solved(noise, weights)
        residual = np.linalg.norm(system.vectors(shared) - smoothed, axis=1) / noise
        weights = 1.0 / (1.0 + (residual / CAUCHY_WIDTH) ** 2)
        noise = system.scatter(shared)
    vectors = system.vectors(shared)
    spread = np.sqrt(noise**2 + GRAVITY_SPREAD**2 + float(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
    long = np.abs(np.linalg.norm(vectors, axis=1) - STANDARD_GRAVITY) <= LENGTH_SIGMAS * spread
    left = vectors - smoothed
    good = long & (np.linalg.norm(left, axis=1) <= ASIDE_SIGMAS * spread)
    return GravityFit(
        windows, vectors, smoothed, noise, shared[:3], covariance[:3, :3], good, _excess(left[good], noise)
    )


def _excess(left: FloatArray, noise: float) -> float:
    """Of `(W, 3)` from what all have together, where that is more than chance, by an F test."""
    if len(left) < 2:
        return 1.0
    ratio = float(np.mean(left**2)) / noise**2
    return float(np.sqrt(ratio)) if ratio > f.isf(BY_CHANCE, 3 * len(left), 3 * (len(left) - 1)) else 1.0


@dataclass(frozen=True, eq=False)
class _System:
    """Unknown are bias and lever arm (6, shared), and gravity of each window.

    Args:
        measured: `(W, 3)`.
        shared: `(W, 3, 6)`: times bias and lever arm their part in what is measured.
        walk: `(W - 1,)` variance of the change of gravity from window to window.
        prior_mean: `(6,)`.
        prior_sigma: `(6,)`.
    """

    measured: FloatArray
    shared: FloatArray
    walk: FloatArray
    prior_mean: FloatArray
    prior_sigma: FloatArray

    @classmethod
    def of(cls, windows: Windows, odometry: Trajectory, R_body_imu: FloatArray, lever_m: FloatArray | None) -> _System:
        near = odometry.nearest(windows.stamps_ns)
        walk = STANDARD_GRAVITY**2 * odometry.rotation_variance_between(near[:-1], near[1:]) / 3.0
        lever = np.zeros(3) if lever_m is None else lever_m
        sigma = LEVER_SIGMA_M if lever_m is None else KNOWN_LEVER_SIGMA_M
        return cls(
            measured=windows.gravity(R_body_imu),
            shared=np.concatenate([windows.bias, windows.lever], axis=2),
            walk=walk + 1e-8,
            prior_mean=np.concatenate([np.zeros(3), lever]),
            prior_sigma=np.repeat([BIAS_SIGMA, sigma], 3),
        )

    def vectors(self, shared: FloatArray) -> FloatArray:
        """`(W, 3)` gravity by each window alone."""
        return np.asarray(self.measured - self.shared @ shared)

    def scatter(self, shared: FloatArray) -> float:
        """Standard deviation of a component, from the changes between neighbours; drift is in it too."""
        changes = np.diff(self.vectors(shared), axis=0)
        return float(MAD_TO_SIGMA * np.median(np.abs(changes)) / np.sqrt(2.0)) + 1e-4

    def solved(self, noise: float, weights: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Shared unknowns `(6,)`, gravity `(W, 3)`, covariance of the shared ones `(6, 6)`."""
        count, sqrt_weight = len(self.measured), np.sqrt(weights) / noise
        of_windows = sparse.kron(sparse.diags(sqrt_weight), sparse.eye(3))
        of_shared = (self.shared * sqrt_weight[:, None, None]).reshape(-1, 6)
        rows, of_walk = np.arange(count - 1), 1.0 / np.sqrt(self.walk)
        steps = sparse.csr_matrix(
            (np.tile([-1.0, 1.0], count - 1) * np.repeat(of_walk, 2),
             (np.repeat(rows, 2), np.stack([rows, rows + 1], axis=1).ravel())),
            (count - 1, count),
        )  # fmt: skip
        walk = sparse.kron(steps, sparse.eye(3))
        nothing, none = sparse.csr_matrix((3 * (count - 1), 6)), sparse.csr_matrix((6, 3 * count))
        rows_of = [
            sparse.hstack([sparse.csr_matrix(of_shared), of_windows]),
            sparse.hstack([nothing, walk]),
            sparse.hstack([sparse.diags(1.0 / self.prior_sigma), none]),
        ]
        J = sparse.csc_matrix(sparse.vstack(rows_of))
        right = np.concatenate(
            [
                (self.measured * sqrt_weight[:, None]).ravel(),
                np.zeros(3 * (count - 1)),
                self.prior_mean / self.prior_sigma,
            ]
        )
        factorised = splu((J.T @ J).tocsc())
        found = factorised.solve(J.T @ right)
        covariance = factorised.solve(np.eye(J.shape[1], 6))[:6]
        return found[:6], found[6:].reshape(-1, 3), covariance


def up_at_keyframes(fit: GravityFit, keyframes: Trajectory) -> UpDirections:
    """The good windows' directions at their nearest keyframes, several of one keyframe as their mean.

    Args:
        fit: in the frame of the keyframes' odometry.
        keyframes: which know the poses between them (`Trajectory.keyframes`).
    """
    stamps_ns, vectors = fit.windows.stamps_ns[fit.good], fit.vectors[fit.good]
    near = keyframes.nearest(stamps_ns)
    index, which, count = np.unique(near, return_inverse=True, return_counts=True)
    up_odom = np.zeros((len(index), 3))
    np.add.at(up_odom, which, vectors / np.linalg.norm(vectors, axis=1)[:, None])
    up_odom /= np.linalg.norm(up_odom, axis=1)[:, None]
    up_body = np.einsum("nji,nj->ni", keyframes.poses[index, :3, :3], up_odom)
    return UpDirections(index, up_body, fit.sigma_rad / np.sqrt(count))
