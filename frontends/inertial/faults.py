"""What is wrong with an IMU's log: each check gives a sentence, or nothing."""

from __future__ import annotations

import numpy as np
from scipy.stats import binom

from wiclosure.frontends.inertial.axes import left_handed
from wiclosure.frontends.inertial.gravity import STANDARD_GRAVITY
from wiclosure.frontends.inertial.turning import CORRELATED, TurningRates, clock_offset_s
from wiclosure.types import BoolArray, FloatArray, ImuLog, IntArray, Trajectory

STUCK_S = 0.5  # of one and the same sample: noise changes the last digit of every real one
VALUES_BELOW = 10  # the extreme one, that it is compared with
BY_CHANCE = 1e-6  # so rarely, an extreme value repeats as often
UNIT_SHARE = 0.25  # off a unit's value, within which it is that unit
LATE_S = 0.05  # clocks that differ by less tilt nothing: a window is a hundred times as long
BETTER_EXPLAINED = 0.5  # of the variance that stays unexplained, where another offset is the right one


def stuck(imu: ImuLog) -> BoolArray:
    """Samples `(N,)` in runs of at least half a second in which the acceleration, or the rate, repeats one value.

    A rate that never changes is none that is stuck, but of an IMU without gyroscope.
    """
    rates = _repeats(imu.stamps_ns, imu.turning_rate)
    return _repeats(imu.stamps_ns, imu.acceleration) | (rates & ~rates.all())


def _repeats(stamps_ns: IntArray, values: FloatArray) -> BoolArray:
    begins = np.flatnonzero(np.concatenate([[True], (np.diff(values, axis=0) != 0).any(axis=1)]))
    ends = np.append(begins[1:], len(values)) - 1
    long = (stamps_ns[ends] - stamps_ns[begins]) * 1e-9 >= STUCK_S
    return np.repeat(long, ends - begins + 1)


def saturated(imu: ImuLog) -> BoolArray:
    """Samples `(N,)` at the end of an axis's range, wherever it lies: a plateau of one and the same extreme value.

    Values thin out towards their extreme, so of the extreme and the ten values below it, it has its share of samples at
    most.  Far more than chance gives it are clipped there.
    """
    clipped = np.zeros(len(imu), bool)
    for signed in (*imu.acceleration.T, *-imu.acceleration.T):
        values, count = np.unique(signed, return_counts=True)
        if len(values) < 2 * VALUES_BELOW or np.median(signed) > values[-VALUES_BELOW - 1]:
            continue  # too few values for any shape
        together = int(count[-VALUES_BELOW - 1 :].sum())
        if binom.sf(count[-1] - 1, together, 1.0 / (VALUES_BELOW + 1)) < BY_CHANCE:
            clipped |= np.abs(signed) == abs(values[-1])  # ranges are the same to both sides
    return clipped


def wrong_unit(imu: ImuLog) -> str:
    """Of the acceleration, by its median length."""
    length = float(np.median(np.linalg.norm(imu.acceleration, axis=1)))
    if abs(length / STANDARD_GRAVITY - 1.0) <= UNIT_SHARE:
        return ""
    if abs(length - 1.0) <= UNIT_SHARE:
        return f"its acceleration has a median of {length:.2f}, so it is in g; set imu_units: [g, rad/s]"
    if abs(length / (1000.0 * STANDARD_GRAVITY) - 1.0) <= UNIT_SHARE or abs(length / 1000.0 - 1.0) <= UNIT_SHARE:
        return f"its acceleration has a median of {length:.0f}, in thousandths; set imu_units: [mg, rad/s]"
    if length < STANDARD_GRAVITY / 3:
        return (
            f"its acceleration has a median of {length:.2f} m/s^2, so gravity was taken out (linear acceleration);"
            " name the topic of raw acceleration"
        )
    return f"its acceleration has a median of {length:.1f} m/s^2, and gravity is 9.81; check its unit"


def not_at_the_same_time(imu: ImuLog, odometry: Trajectory) -> str:
    """Where the log and the scans hardly overlap."""
    begin = max(int(imu.stamps_ns[0]), int(odometry.stamps_ns[0]))
    end = min(int(imu.stamps_ns[-1]), int(odometry.stamps_ns[-1]))
    if end > begin:
        return ""
    apart = (int(imu.stamps_ns[0]) - int(odometry.stamps_ns[0])) * 1e-9
    return f"its clock begins {apart:+.1f} s after the scans', and the two never overlap; set imu_time_offset"


def wrong_rates(imu: ImuLog, odometry: Trajectory, rates: TurningRates) -> str:
    """Turning rates against those of the odometry: clock, unit, or another body altogether."""
    if not rates.tells:
        return ""
    if not np.ptp(imu.turning_rate, axis=0).any():
        return "its turning rates never change, so nothing tells whether its clock and axes are right"
    offset_s, best = clock_offset_s(imu, odometry)
    explains = 1.0 - best**2 < BETTER_EXPLAINED * (1.0 - rates.correlation**2)
    if abs(offset_s) > LATE_S and best > CORRELATED and explains:
        return (
            f"its clock is {abs(offset_s):.2f} s {'behind' if offset_s > 0 else 'ahead of'} the scans', by the turning"
            f" rates; set imu_time_offset: {offset_s:.2f}"
        )
    if rates.correlation < CORRELATED:
        return (
            f"its turning rates do not follow the odometry's (correlation {rates.correlation:.2f}); is it of another"
            " body?"
        )
    return _wrong_axes_or_unit(rates)


def _wrong_axes_or_unit(rates: TurningRates) -> str:
    if left_handed(rates, BETTER_EXPLAINED):
        return "its turning rates are a mirror of the odometry's: its axes are left-handed; turn one of them round"
    if abs(rates.scale / np.radians(1.0) - 1.0) <= UNIT_SHARE:
        return "its turning rates are in degrees; set imu_units: [m/s^2, deg/s]"
    if abs(rates.scale - 1.0) > UNIT_SHARE:
        return f"its turning rates are {1 / max(rates.scale, 1e-9):.2g} times the odometry's; check their unit"
    return ""


def spoiled(imu: ImuLog) -> tuple[BoolArray, BoolArray, list[str]]:
    """Stuck samples `(N,)`, saturated ones `(N,)`, and sentences on both."""
    repeats, clipped = stuck(imu), saturated(imu)
    sentences = []
    if repeats.any():
        sentences.append(
            f"{repeats.sum()} of {len(imu)} IMU samples repeat one value for {STUCK_S} s or more"
            f" ({_time(imu, repeats)}); they are left out"
        )
    if clipped.any():
        sentences.append(
            f"{clipped.sum()} of {len(imu)} IMU samples are at the end of the range,"
            f" {np.abs(imu.acceleration).max():.1f} m/s^2 ({_time(imu, clipped)}); what is near them is left out"
        )
    return repeats, clipped, sentences


def _time(imu: ImuLog, rows: BoolArray) -> str:
    first = int(np.argmax(rows))
    return f"the first {(int(imu.stamps_ns[first]) - int(imu.stamps_ns[0])) * 1e-9:.1f} s after its start"


def contradicts(given: FloatArray, found: FloatArray, sigma_rad: FloatArray) -> float:
    """Angle, rad, between two rotations `(3, 3)`, where it is more than the second is unsure of; else 0."""
    angle = float(np.arccos(np.clip((np.trace(given.T @ found) - 1.0) / 2.0, -1.0, 1.0)))
    if not np.isfinite(sigma_rad).all():
        return 0.0
    return angle if angle > max(np.radians(5.0), 4.0 * float(np.linalg.norm(sigma_rad))) else 0.0
