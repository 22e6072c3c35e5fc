"""A log read anew under a blunder that its measurements cannot tell from none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from wiclosure.types import FrameAlignment, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.alignment.indistinguishable import BLUNDERS
from wiclosure.wiclosure_filter.faults.corrections import undone
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

_BY_CLAUSE = {blunder.clause: blunder for blunder in BLUNDERS}


def reread(
    alignment: FrameAlignment,
    links: Links,
    trajectories: Mapping[str, Trajectory],
    log: WirelessLog,
    limits: GatheringLimits,
) -> tuple[FrameAlignment, Links]:
    """An alignment of two robots and their links as they are if the blunder of `alignment.best` was made.

    Constant errors were estimated without it, so only their priors are left.

    Args:
        alignment: with the hypothesis that is looked at as its best.
        links: as the log claims.
        trajectories: of both robots, a first.
        log: all measurements.
        limits: which of them become links.
    """
    if alignment.best is None or not alignment.best.blunder:
        return alignment, links
    rows = links.measurement
    between = replace(log, measurements=tuple(log.measurements[row] for row in rows.tolist()))
    undo = undone(_BY_CLAUSE[alignment.best.blunder], links.robot_a, links.robot_b)
    (read,) = TeamLinks.of(*undo.apply((trajectories, between)), limits).by_pair.values()
    unknown = tuple(replace(one, value=0.0) for one in alignment.calibration)
    return replace(alignment, calibration=unknown), replace(read, measurement=np.asarray(rows[read.measurement]))
