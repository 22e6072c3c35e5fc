"""Axes of an IMU that are exchanged, turned round or left-handed: another choice of them explains it far better."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product

import numpy as np

from wiclosure.frontends.inertial.turning import TurningRates
from wiclosure.frontends.inertial.windows import Windows
from wiclosure.types import FloatArray

CHOICES = np.array(
    [np.diag(signs)[list(order)] for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)]
)
"""`(48, 3, 3)`: every order and sign of three axes; the first changes nothing."""

MIRROR = np.diag([-1.0, 1.0, 1.0])  # all others are this and a rotation
FEWEST_TO_CHOOSE = 8  # windows: among so many choices, one fits fewer by chance


def rechosen(windows: Windows, choice: FloatArray) -> Windows:
    """Windows of the same log with its acceleration's axes chosen otherwise, by `(3, 3)`."""
    return replace(windows, force=np.einsum("wijm,km->wijk", windows.force, choice))


def best_choice(windows: Windows, R_body_imu: FloatArray) -> FloatArray:
    """The choice `(3, 3)` of the acceleration's axes under which gravity changes least from window to window."""
    if len(windows) < FEWEST_TO_CHOOSE:
        return -np.eye(3)
    gravity = np.einsum("wijm,ckm,jk->cwi", windows.force, CHOICES, R_body_imu) - windows.acceleration
    scatter = np.median(np.abs(np.diff(gravity, axis=1)), axis=(1, 2))
    return np.asarray(CHOICES[int(np.argmin(scatter))])


def in_words(choice: FloatArray) -> str:
    """Such as `+y, -x, +z`: what to take for x, y and z."""
    return ", ".join(("+" if row.sum() > 0 else "-") + "xyz"[int(np.argmax(np.abs(row)))] for row in choice)


def left_handed(rates: TurningRates, better: float) -> bool:
    """Whether a mirror explains turning rates so much better than any rotation: it leaves that share of variance."""
    odometry, imu = (of - of.mean(axis=0) for of in (rates.odometry, rates.imu))
    U, size, Vt = np.linalg.svd(odometry.T @ imu)
    both = float(np.sum(odometry**2) + np.sum(imu**2))
    mirror = np.linalg.det(U @ Vt) < 0
    rotated, mirrored = (both - 2.0 * float(size[0] + size[1] + sign * size[2]) for sign in (-1.0, 1.0))
    return bool(mirror and mirrored < better * rotated)
