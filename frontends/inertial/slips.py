"""Steps of an odometry that no robot made: it lost its hold and found another one, and says nothing of it.

From scan to scan a robot goes on nearly as before: masses are inert.  A step that departs from the one before by far
more than its neighbours do, and by an acceleration that no such robot reaches, is taken for a slip; where a gyroscope
is there, so is one that turns otherwise than it felt.  The step stays as it is, but counts as unknown by as much as it
departs: loops may then mend the map there.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from wiclosure import se3
from wiclosure.frontends.inertial.turning import TurningRates
from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory

UNLIKE = (
    10.0  # times the lower quartile of departures of moving steps: nine sigma of those that hold, with many slips too
)
INERT_MPS2 = 5.0  # half of gravity: tyres and legs hold no more for long
TURN_RPS2 = 20.0  # rad/s^2, of turning; a head that is shaken reaches it
MOVING = 0.2  # of the fastest tenth's speed, from which a step counts as moving
LEAST_TURN_RAD = np.radians(3.0)  # that odometry and gyroscope must differ by in a step
STEP_FLOOR = np.diag(np.repeat([0.0001**2, 0.001**2], 3))  # a step on the spot, of which the drift model says nothing


@dataclass(frozen=True, eq=False)
class Slips:
    """S steps of an odometry that are not to be trusted.

    Args:
        index: `(S,)` the pose that the step leads to.
        stamps_ns: `(S,)` of that pose.
        departure_m: `(S,)` how far the step departs from the motion before.
        departure_rad: `(S,)` likewise.
        gross: `(S,)` whether no inertia allows it; others come after such a one, in a map that is no longer whole.
    """

    index: IntArray
    stamps_ns: IntArray
    departure_m: FloatArray
    departure_rad: FloatArray
    gross: BoolArray

    def __len__(self) -> int:
        return len(self.index)

    def __add__(self, more: Slips) -> Slips:
        """Both, each step once: as the one has it that trusts it less."""
        both = Slips(*(np.concatenate([getattr(self, of.name), getattr(more, of.name)]) for of in fields(self)))
        order = np.lexsort((-both.departure_m - both.departure_rad, ~both.gross, both.index))
        _, first = np.unique(both.index[order], return_index=True)
        return both.subset(order[first])

    def subset(self, rows: IntArray) -> Slips:
        """Some of the steps."""
        return Slips(*(getattr(self, of.name)[rows] for of in fields(self)))

    @classmethod
    def none(cls) -> Slips:
        """Of an odometry that holds."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.zeros(0, bool))

    def sentence(self, start_ns: int) -> str:
        """For the user: when, and by how much; empty without slips."""
        if not len(self):
            return ""
        worst = int(np.argmax(np.where(self.gross, self.departure_m + self.departure_rad, -1.0)))
        seconds = [(int(ns) - start_ns) * 1e-9 for ns in self.stamps_ns]
        gross = [at for at, of in zip(seconds, self.gross.tolist(), strict=True) if of]
        times = ", ".join(f"{at:.1f}" for at in gross[:8]) + (" ..." if len(gross) > 8 else "")
        often, most = ("once", "") if len(gross) == 1 else (f"{len(gross)} times", f" most at {seconds[worst]:.1f} s,")
        return (
            f"odometry slips {often}, at {times} s after its start,{most} by"
            f" {self.departure_m[worst]:.1f} m and {np.degrees(self.departure_rad[worst]):.0f} degrees;"
            " from then on steps count as unknown by how they depart from the motion before, and loops may mend them"
        )


def find_slips(odometry: Trajectory) -> Slips:
    """Steps that depart from the motion before by what no inertia allows.

    Args:
        odometry: `T_odom_body` of all scans.
    """
    seconds = np.diff(odometry.stamps_ns) * 1e-9
    if len(seconds) < 3:
        return Slips.none()
    steps = se3.log(se3.between(odometry.poses[:-1], odometry.poses[1:]))
    expected = se3.exp(steps[:-1] * (seconds[1:] / seconds[:-1])[:, None])
    off = se3.log(se3.between(expected, se3.exp(steps[1:])))
    departure_rad, departure_m = (np.linalg.norm(part, axis=1) for part in (off[:, :3], off[:, 3:]))
    apart_s2 = seconds[1:] * 0.5 * (seconds[1:] + seconds[:-1])
    speed = np.linalg.norm(steps[1:, 3:], axis=1) / seconds[1:]
    moving = speed >= MOVING * np.quantile(speed, 0.9)
    gross = np.zeros(len(off), bool)
    for departure, most in ((departure_m, INERT_MPS2), (departure_rad, TURN_RPS2)):
        acceleration = departure / apart_s2
        usual = float(np.quantile(acceleration[moving], 0.25)) if moving.any() else 0.0
        gross |= acceleration > max(most, UNLIKE * usual)
    if not gross.any():
        return Slips.none()
    index = np.arange(int(np.argmax(gross)), len(gross))
    stamps_ns = odometry.stamps_ns[index + 2]
    return Slips(index + 2, stamps_ns, departure_m[index], departure_rad[index], gross[index])


def lost_steps(odometry: Trajectory, index: IntArray) -> Slips:
    """Steps to scans that fit nowhere: unknown by as much as the robot may have moved.

    Args:
        odometry: `T_odom_body` of all scans.
        index: `(S,)` poses of these scans, from the first on.
    """
    index = index[index > 0]
    before = np.maximum(index - 2, 0)
    steps = se3.log(se3.between(odometry.poses[index - 1], odometry.poses[index]))
    earlier = se3.log(se3.between(odometry.poses[before], odometry.poses[index - 1]))
    far = np.linalg.norm(steps.reshape(-1, 2, 3), axis=2) + np.linalg.norm(earlier.reshape(-1, 2, 3), axis=2)
    return Slips(index, odometry.stamps_ns[index], far[:, 1], far[:, 0], np.ones(len(index), bool))


def turned_otherwise(odometry: Trajectory, rates: TurningRates, R_body_imu: FloatArray) -> Slips:
    """Steps that turn otherwise than a gyroscope felt, by far more than most do.

    Args:
        odometry: `T_odom_body` of all scans.
        rates: of it and of the gyroscope.
        R_body_imu: `(3, 3)` mounting.
    """
    off = (rates.odometry - rates.imu @ R_body_imu.T) * rates.seconds[:, None]
    off -= np.median(off, axis=0)  # the gyroscope's bias
    departure_rad = np.linalg.norm(off, axis=1)
    usual = float(np.quantile(departure_rad, 0.25)) if len(departure_rad) else 0.0
    slipped = departure_rad > max(LEAST_TURN_RAD, UNLIKE * usual)
    index = rates.step[slipped] + 1
    moved = np.linalg.norm(odometry.positions[index] - odometry.positions[index - 1], axis=1)
    return Slips(index, odometry.stamps_ns[index], moved, departure_rad[slipped], np.ones(len(index), bool))


def opened(odometry: Trajectory, slips: Slips) -> Trajectory:
    """The odometry with covariances of its steps by the drift model, and wider where it slipped."""
    if not len(slips):
        return odometry
    first = np.arange(len(odometry) - 1)
    covariances = odometry.relative_covariance(first, first + 1) + STEP_FLOOR
    wider = np.concatenate(
        [np.repeat(slips.departure_rad[:, None], 3, axis=1), np.repeat(slips.departure_m[:, None], 3, axis=1)], axis=1
    )
    covariances[slips.index - 1] += wider[:, :, None] ** 2 * np.eye(6)
    return replace(odometry, step_covariances=covariances)
