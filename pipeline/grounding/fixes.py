"""GNSS fixes that can be true at all: places on the Earth, not repeated, no farther apart than the robot drove."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure.geodesy import enu_of
from wiclosure.pipeline.data.inputs import GnssInput
from wiclosure.types import BoolArray, GnssLog, Trajectory

REACH = 2.0  # path lengths from the middle fix: a true one is within one of any other, the middle is taken by axis


def credible(receiver: GnssInput, path: Trajectory) -> tuple[GnssInput, list[str]]:
    """Without fixes that cannot be true, and a sentence for each reason.

    Args:
        receiver: all fixes of one robot.
        path: its keyframes.
    """
    log, sentences = receiver.log, list[str]()
    for reason in (_nowhere, _repeated, _beyond_reach):
        wrong, what = reason(log, path)
        if wrong.any():
            sentences.append(f"{int(wrong.sum())} of {len(log)} GNSS fixes are left out: {what}")
            log = GnssLog(log.stamps_ns[~wrong], log.geodetic[~wrong], log.sigma_enu[~wrong])
    return replace(receiver, log=log), sentences


def _nowhere(log: GnssLog, _: Trajectory) -> tuple[BoolArray, str]:
    finite = np.isfinite(log.geodetic).all(axis=1) & np.isfinite(log.sigma_enu).all(axis=1)
    zero = (log.geodetic[:, :2] == 0.0).all(axis=1)
    return ~finite | zero | (log.sigma_enu <= 0.0).any(axis=1), "not finite, at 0/0, or without a standard deviation"


def _repeated(log: GnssLog, _: Trajectory) -> tuple[BoolArray, str]:
    """A receiver without reception may go on with its last fix, to the last digit."""
    same = np.zeros(len(log), bool)
    same[1:] = (log.geodetic[1:] == log.geodetic[:-1]).all(axis=1)
    return same, "they repeat the one before"


def _beyond_reach(log: GnssLog, path: Trajectory) -> tuple[BoolArray, str]:
    if not len(log):
        return np.zeros(0, bool), ""
    length_m = float(path.distance[-1])
    during = path.covers(log.stamps_ns)
    middle = np.median(log.geodetic[during] if during.any() else log.geodetic, axis=0)
    off_m = np.linalg.norm(enu_of(log.geodetic, middle)[:, :2], axis=1)
    reach_m = REACH * length_m + 10.0 * float(np.median(log.sigma_enu))
    return during & (off_m > reach_m), f"farther from the others than the {length_m:.0f} m that the robot moved"
