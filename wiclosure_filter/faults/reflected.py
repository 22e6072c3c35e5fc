"""A wall that hides one robot hides others: two robots that heard a reflection put in doubt what the others heard.

An image in a wall moves as odometry does that has y to the right.  Where two robots' measurements fit only so, a wall
may be why as well as the odometry.  Then it hides a share of all pairs of robots, of which nothing is known beforehand;
those whose measurements refute an image make it smaller.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from scipy.special import logsumexp

from wiclosure.types import FloatArray, FrameAlignment
from wiclosure.wiclosure_filter.alignment.indistinguishable import REFLECTED, USUAL
from wiclosure.wiclosure_filter.config import AmbiguitySettings
from wiclosure.wiclosure_filter.faults.corrections import Correction

RobotPair: TypeAlias = tuple[str, str]

_SHARES = (np.arange(100) + 0.5) / 100  # of the pairs of robots that a wall hides


def reflections_in_doubt(
    alignments: Mapping[RobotPair, FrameAlignment], faults: Mapping[RobotPair, Correction], guard: AmbiguitySettings
) -> dict[RobotPair, str]:
    """Of alignments that prune, those that a wall may have mirrored as it did others: why, as a sentence.

    Args:
        alignments: of all pairs of robots.
        faults: what is named for some of them.
        guard: odds that are enough.
    """
    mirrored = {pair: fault.fault for pair, fault in faults.items() if fault.mirrored}
    weighed = [pair for pair, one in alignments.items() if pair not in faults and np.isfinite(one.log_image)]
    if not mirrored or not weighed or not guard.weigh_blunders:
        return {}
    log_image = np.array([alignments[pair].log_image for pair in weighed])
    odds = np.exp(_log_odds(log_image, len(mirrored), len(set(mirrored.values())), guard.min_odds))
    told = ", ".join(f"{a} and {b}" for a, b in mirrored)
    return {
        pair: (
            f"{told} measured what images in a wall would show; such a wall may hide these two as well, whose"
            f" measurements do not refute it (odds {1 / against:.0f} to 1 against)"
        )
        for pair, against in zip(weighed, odds, strict=True)
        if against * guard.min_odds >= 1.0 and _prunes(alignments[pair])
    }


def _prunes(alignment: FrameAlignment) -> bool:
    return not alignment.ambiguous or bool(alignment.likely_alternatives)


def _log_odds(log_image: FloatArray, mirrored: int, robots: int, min_odds: float) -> FloatArray:
    """`(P,)` natural logarithm of the odds that a wall hides each of P pairs.

    Where noise alone may have decided against an image, it counts in full.

    Args:
        log_image: `(P,)` how much likelier an image makes what they measured.
        mirrored: number of other pairs that heard images, or robots with y to the right.
        robots: how many of these there would be.
        min_odds: up to which noise decides.
    """
    log_image = np.where(log_image > -np.log(min_odds), np.maximum(log_image, 0.0), log_image)
    hidden = np.log(_SHARES)[:, None] + log_image
    seen = np.log1p(-_SHARES)[:, None]
    either = np.logaddexp(hidden, seen)
    others = (mirrored * np.log(_SHARES) + either.sum(axis=1))[:, None] - either + np.log(REFLECTED / len(_SHARES))
    by_odometry = robots * np.log(USUAL)
    return np.asarray(logsumexp(others + hidden, axis=0) - np.logaddexp(logsumexp(others + seen, axis=0), by_odometry))
