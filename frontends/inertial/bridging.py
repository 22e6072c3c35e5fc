"""Stretches on which odometry goes otherwise than its IMU felt: the IMU's own motion is taken there.

Where a street shows little along it, odometry slips for seconds by a little with each scan, and no single step tells.
Over a window of some seconds turning rates add up to a turn, and specific force without gravity to a change of
velocity.  Velocities follow from both sensors (a smoother: the force ties them to each other, odometry's displacements
to the world, under a kernel that lets slips go), and so do the displacements that odometry should have had.
Where turn or displacement over a window depart by ten times what they usually do, its steps are those of the IMU.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from wiclosure import se3
from wiclosure.frontends.inertial.faults import spoiled
from wiclosure.frontends.inertial.gravity import CAUCHY_WIDTH, LEVER_SIGMA_M, MAD_TO_SIGMA, GravityFit
from wiclosure.frontends.inertial.slips import UNLIKE
from wiclosure.frontends.inertial.turning import TurningRates
from wiclosure.frontends.inertial.windows import WINDOW_S, integrated, seconds_since
from wiclosure.types import BoolArray, FloatArray, ImuLog, IntArray, Trajectory

USUAL = 0.25  # quantile of departures that is usual, with many slips too
MOST_BRIDGED = 0.5  # of the steps: an IMU that disagrees with more is not one to follow
SCALE_ERROR = 0.01  # of turning rates, and misaligned axes likewise: grows with the turn
FORCE_SIGMA = 0.2  # m/s^2, of specific force without gravity: tilt, bias, and what happens between samples
ROUNDS = 30  # of reweighting


@dataclass(frozen=True, eq=False)
class Bridged:
    """An odometry whose steps are partly an IMU's.

    Args:
        odometry: `T_odom_body`, in the frame of the one given.
        steps: `(N - 1,)` which steps were replaced.
        moved_m: `(P,)` how far odometry was off over each stretch.
        turned_rad: `(P,)` likewise.
    """

    odometry: Trajectory
    steps: BoolArray
    moved_m: FloatArray
    turned_rad: FloatArray

    def sentence(self) -> str:
        """For the user: when, and by how much; empty where nothing was replaced."""
        begin, end = _stretches(self.steps)
        if not len(begin):
            return ""
        t = seconds_since(self.odometry, self.odometry.stamps_ns)
        worst = int(np.argmax(self.moved_m))
        times = ", ".join(f"{t[i]:.0f}-{t[j]:.0f}" for i, j in zip(begin[:8], end[:8], strict=True))
        return (
            f"odometry goes otherwise than its IMU felt {times}{' ...' if len(begin) > 8 else ''} s after its start, by"
            f" {self.moved_m[worst]:.1f} m and {np.degrees(self.turned_rad[worst]):.1f} degrees"
            f"{' from ' + format(t[begin[worst]], '.0f') + ' s on' if len(begin) > 1 else ''}; the IMU's motion is"
            " taken there"
        )


def bridged(
    odometry: Trajectory, imu: ImuLog, fit: GravityFit, R_body_imu: FloatArray, lever_m: FloatArray | None = None
) -> Bridged:
    """The odometry, with the IMU's motion where the two depart.

    Args:
        odometry: `T_odom_body` of all scans.
        imu: in the clock of the odometry.
        fit: gravity and bias along this odometry.
        R_body_imu: `(3, 3)` mounting.
        lever_m: `(3,)` the IMU's place in the body, or None where it is not known.
    """
    repeats, clipped, _ = spoiled(imu)
    imu = imu.subset(~(repeats | clipped))
    rates, seconds = TurningRates.of(imu, odometry), np.diff(seconds_since(odometry, odometry.stamps_ns))
    nothing = Bridged(odometry, np.zeros(len(seconds), bool), np.zeros(0), np.zeros(0))
    if len(rates) < 2:
        return nothing
    known = np.zeros(len(seconds), bool)
    known[rates.step] = True
    windows = _windows(odometry, known)
    turns = se3.log(se3.between(odometry.poses[:-1], odometry.poses[1:]))[:, :3]
    felt = turns.copy()
    felt[rates.step] = (rates.imu @ R_body_imu.T) * rates.seconds[:, None]
    if not len(windows[0]):
        return nothing
    mean = _over(windows, turns - felt) / _over(windows, seconds[:, None])
    felt[known] += np.median(mean, axis=0) * seconds[known, None]  # the gyroscope's bias
    turn = np.linalg.norm(_over(windows, np.abs(felt)), axis=1)
    off = np.einsum("nij,nj->ni", odometry.poses[:-1, :3, :3], turns - felt)
    otherwise = _unlike(windows, off, SCALE_ERROR * turn, len(seconds))
    upright = _composed(odometry, otherwise, felt, None)
    displacement = _felt_displacements(upright, imu, fit, R_body_imu, lever_m, known)
    off = np.diff(upright.positions, axis=0) - displacement
    lever = LEVER_SIGMA_M if lever_m is None else 0.0
    otherwise |= _unlike(windows, off, lever * turn, len(seconds))
    if not otherwise.any() or otherwise.mean() > MOST_BRIDGED:
        return nothing
    new = _composed(odometry, otherwise, felt, np.einsum("nji,nj->ni", upright.poses[:-1, :3, :3], displacement))
    begin, end = _stretches(otherwise)
    apart = se3.log(se3.between(se3.between(odometry.poses[begin], odometry.poses[end]),
                                se3.between(new.poses[begin], new.poses[end])))  # fmt: skip
    return Bridged(new, otherwise, np.linalg.norm(apart[:, 3:], axis=1), np.linalg.norm(apart[:, :3], axis=1))


def _windows(odometry: Trajectory, known: BoolArray) -> tuple[IntArray, IntArray]:
    """First and last pose `(W,)` of all windows in which the IMU has no gap, one from each pose on."""
    t = seconds_since(odometry, odometry.stamps_ns)
    first = np.arange(len(t))
    last = np.searchsorted(t, t + WINDOW_S)
    whole = last < len(t)
    first, last = first[whole], last[whole]
    unknown = np.concatenate([[0], np.cumsum(~known)])
    gapless = unknown[last] == unknown[first]
    return first[gapless], last[gapless]


def _over(windows: tuple[IntArray, IntArray], values: FloatArray) -> FloatArray:
    """Sums `(W, D)` of what the steps `(N - 1, D)` have, over the windows."""
    summed = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    return np.asarray(summed[windows[1]] - summed[windows[0]])


def _unlike(windows: tuple[IntArray, IntArray], off: FloatArray, allowed: FloatArray, steps: int) -> BoolArray:
    """Steps `(N - 1,)` in windows over which they add up to far more than they usually do."""
    departure = np.linalg.norm(_over(windows, off), axis=1)
    far = departure > UNLIKE * np.quantile(departure, USUAL) + allowed
    opened = np.zeros(steps + 1, np.int64)
    np.add.at(opened, windows[0][far], 1)
    np.add.at(opened, windows[1][far], -1)
    return np.asarray(np.cumsum(opened)[:-1] > 0)


def _stretches(steps: BoolArray) -> tuple[IntArray, IntArray]:
    """First and last pose `(P,)` of the runs of steps that are set."""
    edges = np.diff(np.concatenate([[False], steps, [False]]).astype(np.int8))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def _composed(odometry: Trajectory, steps: BoolArray, felt: FloatArray, moved: FloatArray | None) -> Trajectory:
    """The odometry with other turns `(N - 1, 3)` and, where given, displacements in the body's axes at some steps."""
    T = se3.between(odometry.poses[:-1], odometry.poses[1:])
    T[steps, :3, :3] = se3.exp(np.concatenate([felt, np.zeros_like(felt)], axis=1)[steps])[:, :3, :3]
    if moved is not None:
        T[steps, :3, 3] = moved[steps]
    poses = [odometry.poses[0]]
    for step in T:
        poses.append(poses[-1] @ step)
    return replace(odometry, poses=np.stack(poses), step_covariances=None)


def _felt_displacements(
    odometry: Trajectory,
    imu: ImuLog,
    fit: GravityFit,
    R_body_imu: FloatArray,
    lever_m: FloatArray | None,
    known: BoolArray,
) -> FloatArray:
    """Displacements `(N - 1, 3)` of all steps in the odometry frame, as both sensors have them together."""
    t, t_imu = (seconds_since(odometry, stamps) for stamps in (odometry.stamps_ns, imu.stamps_ns))
    at = np.clip(imu.stamps_ns, odometry.stamps_ns[0], odometry.stamps_ns[-1])
    R, t_fit = odometry.at(at)[:, :3, :3], seconds_since(odometry, fit.windows.stamps_ns)
    gravity = np.stack([np.interp(t_imu, t_fit, fit.smoothed[:, axis]) for axis in range(3)], axis=1)
    force = np.einsum("nij,nj->ni", R, imu.acceleration @ R_body_imu.T - fit.bias) - gravity
    velocity = integrated(t_imu, force)
    path = integrated(t_imu, velocity)
    V, P = (np.stack([np.interp(t, t_imu, x[:, axis]) for axis in range(3)], axis=1) for x in (velocity, path))
    seconds = np.diff(t)
    by_force = np.diff(P, axis=0) - V[:-1] * seconds[:, None]
    lever = np.zeros(3) if lever_m is None else lever_m
    swung = np.diff(odometry.poses[:, :3, :3] @ lever, axis=0)  # how far the IMU moves by turning alone
    moved = np.diff(odometry.positions, axis=0) + swung
    v = _velocities(moved - by_force, np.diff(V, axis=0), seconds, known)
    return np.asarray(v[:-1] * seconds[:, None] + by_force - swung)


def _velocities(moved: FloatArray, changes: FloatArray, seconds: FloatArray, known: BoolArray) -> FloatArray:
    """`(N, 3)` at the poses, from displacements without acceleration `(N - 1, 3)` and changes of velocity.

    A tridiagonal system, solved again and again with weights of a Geman-McClure kernel for the displacements: what
    slips for seconds on end must count nothing, or it would bend the velocities to itself.
    """
    tied = known / np.maximum(FORCE_SIGMA * seconds, 1e-9) ** 2
    weights = np.ones(len(seconds))
    for _ in range(ROUNDS):
        held = weights * seconds
        diagonal = np.zeros(len(seconds) + 1)
        diagonal[:-1] += held * seconds + tied
        diagonal[1:] += tied
        diagonal[-1] += 1e-9  # where the last step is tied to nothing
        right = np.zeros((len(seconds) + 1, 3))
        right[:-1] += held[:, None] * moved - tied[:, None] * changes
        right[1:] += tied[:, None] * changes
        found = splu(sparse.diags([diagonal, -tied, -tied], [0, 1, -1], format="csc")).solve(right)
        residual = np.linalg.norm(moved - found[:-1] * seconds[:, None], axis=1)
        sigma = max(MAD_TO_SIGMA * float(np.median(residual)) / np.sqrt(3.0), 1e-4)
        weights = 1.0 / (sigma * (1.0 + (residual / (CAUCHY_WIDTH * sigma)) ** 2)) ** 2
    return np.asarray(found)
