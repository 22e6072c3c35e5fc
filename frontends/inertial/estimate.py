"""From an IMU's log and a robot's odometry to directions up at its keyframes, or a sentence why there are none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from wiclosure import se3
from wiclosure.frontends.inertial import faults
from wiclosure.frontends.inertial.axes import FEWEST_TO_CHOOSE, MIRROR, best_choice, in_words, rechosen
from wiclosure.frontends.inertial.gravity import STANDARD_GRAVITY, GravityFit, fit_gravity, up_at_keyframes
from wiclosure.frontends.inertial.mounting import Mounting, find_mounting
from wiclosure.frontends.inertial.slips import Slips, turned_otherwise
from wiclosure.frontends.inertial.turning import TurningRates
from wiclosure.frontends.inertial.windows import WINDOW_S, Windows, windows_along
from wiclosure.types import BoolArray, FloatArray, ImuLog, Trajectory, UpDirections

FEWEST_WINDOWS = 3
LEAST_GOOD = 2 / 3  # of the windows, whose length is that of gravity
MOST_REPEATED = 0.5  # of the samples
LOOSEST_RAD = np.radians(10.0)  # directions that are less sure tell nothing that the drift model does not
OPPOSITE = 0.7  # of the scatter, that other axes must leave to be the right ones


@dataclass(frozen=True, eq=False)
class UpEstimate:
    """What an IMU tells of one robot.

    Args:
        sentences: what was found, left out or refused, for the user.
        up: directions at keyframes, or None where the IMU is not used.
        T_level_odom: `(4, 4)` the smallest turn after which z of the odometry frame points up.
        fit: gravity in its windows, for whoever wants more.
        mounting: where the axes were found rather than given.
        slips: steps of the odometry that turn otherwise than the gyroscope felt.
    """

    sentences: tuple[str, ...]
    up: UpDirections | None = None
    T_level_odom: FloatArray | None = None
    fit: GravityFit | None = None
    mounting: Mounting | None = None
    slips: Slips = field(default_factory=Slips.none)


def estimate_up(
    imu: ImuLog, odometry: Trajectory, keyframes: Trajectory, T_body_imu: FloatArray | None = None
) -> UpEstimate:
    """Directions up, where the log withstands every check.

    Args:
        imu: in the clock of the odometry.
        odometry: `T_odom_body` of all scans.
        keyframes: of the same odometry.
        T_body_imu: `(4, 4)` mounting, or None where it is to be found.
    """
    repeats, clipped, sentences = faults.spoiled(imu)
    if problem := _nothing_in(imu, odometry, repeats):
        return _refused(problem, sentences)
    spoiled_ns, imu = imu.stamps_ns[clipped], imu.subset(~repeats)
    windows, rates = windows_along(imu, odometry, spoiled_ns), TurningRates.of(imu, odometry)
    if problem := faults.wrong_rates(imu, odometry, rates) or _too_few(windows):
        return _refused(problem, sentences)
    R, mounting, problem = _axes(T_body_imu, rates, windows)
    if problem or R is None:
        return _refused(problem, sentences)
    lever_m = None if T_body_imu is None else T_body_imu[:3, 3]
    fit = fit_gravity(windows, odometry, R, lever_m)

    def otherwise(choice: FloatArray, R_body_imu: FloatArray = R) -> GravityFit:
        return fit_gravity(rechosen(windows, choice), odometry, R_body_imu, lever_m)

    if mounting is not None and len(windows) >= FEWEST_TO_CHOOSE:
        of_mirror = find_mounting(rates, rechosen(windows, MIRROR)).R_body_imu
        if otherwise(MIRROR, of_mirror).noise < OPPOSITE * fit.noise:
            return _refused("its acceleration fits the odometry far better in a mirror; correct its axes", sentences)
    if problem := _other_axes(fit, otherwise, best_choice(windows, R)) or _no_gravity(fit):
        return _refused(problem, sentences)
    told = [*sentences, *_account(fit, mounting)]
    T_level_odom = se3.from_rotation_translation(fit.R_level_odom, np.zeros(3))
    slips = turned_otherwise(odometry, rates, R) if rates.tells else Slips.none()
    return UpEstimate(tuple(told), up_at_keyframes(fit, keyframes), T_level_odom, fit, mounting, slips)


def _refused(problem: str, sentences: list[str]) -> UpEstimate:
    return UpEstimate((*sentences, f"its IMU is not used: {problem}"))


def _nothing_in(imu: ImuLog, odometry: Trajectory, repeats: BoolArray) -> str:
    """Why the whole log is useless, or nothing."""
    if len(imu) < 2:
        return f"it has {len(imu)} samples"
    if repeats.mean() > MOST_REPEATED:
        return "it repeats one value most of the time"
    if dead := [axis for axis, spread in zip("xyz", np.ptp(imu.acceleration, axis=0), strict=True) if spread == 0]:
        return f"its acceleration along {' and '.join(dead)} never changes"
    return faults.wrong_unit(imu) or faults.not_at_the_same_time(imu, odometry)


def _too_few(windows: Windows) -> str:
    if len(windows) >= FEWEST_WINDOWS:
        return ""
    return (
        f"{len(windows)} windows of {WINDOW_S:g} s have neither gaps nor clipped samples; {FEWEST_WINDOWS} are needed"
    )


def _axes(
    T_body_imu: FloatArray | None, rates: TurningRates, windows: Windows
) -> tuple[FloatArray | None, Mounting | None, str]:
    """The rotation `(3, 3)` to use, the mounting if it was found, and what speaks against both."""
    found = find_mounting(rates, windows) if rates.tells else None
    if T_body_imu is not None:
        R = T_body_imu[:3, :3]
        angle = 0.0 if found is None else faults.contradicts(R, found.R_body_imu, found.sigma_rad)
        if angle:
            return None, None, (
                f"its axes are said to be turned otherwise than it felt, {np.degrees(angle):.0f} degrees off; correct"
                " imu_pose or /tf_static"
            )  # fmt: skip
        return R, None, ""
    if found is None:
        return None, None, "its axes are not told, and the robot turns too little to find them; set imu_pose"
    if not found.observable:
        worst = np.degrees(min(float(found.sigma_rad.max()), np.pi))
        return None, None, (
            f"its axes are not told, and this drive tells them to {worst:.0f} degrees only; set imu_pose"
        )  # fmt: skip
    return found.R_body_imu, found, ""


def _other_axes(fit: GravityFit, otherwise: Callable[[FloatArray], GravityFit], best: FloatArray) -> str:
    """Whether other axes of the acceleration explain it better, or turn the robot over without need."""
    if otherwise(best).noise < OPPOSITE * fit.noise:
        if (best == -np.eye(3)).all():
            return "its acceleration points down at rest, so its sign is wrong; turn it round"
        return (
            f"its acceleration fits the odometry far better with {in_words(best)} for x, y, z; correct its axes, which"
            f" must be {'those of its turning rates' if np.linalg.det(best) > 0 else 'right-handed'}"
        )
    if fit.R_level_odom[2, 2] < 0 and fit.noise > OPPOSITE * otherwise(-np.eye(3)).noise:
        return (
            "by it the LiDAR hangs upside down, which the robot's own motion does not confirm; turn its sign round, or"
            " correct its axes"
        )
    return ""


def _no_gravity(fit: GravityFit) -> str:
    """Why what was found is not gravity, or nothing."""
    if fit.good.mean() < LEAST_GOOD:
        return (
            f"what is left of its acceleration without the robot's own motion is {fit.length:.2f} m/s^2 long and"
            f" scatters by {fit.noise:.2f}, and gravity is {STANDARD_GRAVITY}"
        )
    if fit.sigma_rad > LOOSEST_RAD:
        return f"it tells up to {np.degrees(fit.sigma_rad):.0f} degrees only"
    return ""


def _account(fit: GravityFit, mounting: Mounting | None) -> list[str]:
    sentences = []
    if mounting is not None:
        sentences.append(
            f"the axes of its IMU were found from its own motion, to {np.degrees(mounting.sigma_rad.max()):.2f} degrees"
        )
    left_out = int((~fit.good).sum())
    sentences.append(
        f"gravity in {len(fit.windows)} windows of {WINDOW_S:g} s, {np.degrees(fit.sigma_rad):.2f} degrees each"
        + (f"; {left_out} are left out, of another length than {STANDARD_GRAVITY} m/s^2" if left_out else "")
    )
    return sentences
