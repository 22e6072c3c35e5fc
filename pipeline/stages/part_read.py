"""Of recordings that are read in part (`-n`) the radio of that part counts: the rest of a log is no sign of a clock."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace

from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.types import WirelessLog, WirelessMeasurement

logger = logging.getLogger(__name__)


def without_later_radio(inputs: Inputs, fronts: Mapping[str, FrontEndResult]) -> Inputs:
    """Without what was measured after the last scan of a robot of which not all scans were to be read.

    Args:
        inputs: with the number of scans at which reading ends, if any.
        fronts: what became of the scans, by robot.
    """
    if inputs.limit is None:
        return inputs
    ends_ns = {
        robot: int(front.scans.stamps_ns[-1]) for robot, front in fronts.items() if front.counts.scans >= inputs.limit
    }

    def is_later(m: WirelessMeasurement) -> bool:
        sent_ns = m.stamp_ns if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns
        return any(
            robot in ends_ns and at_ns > ends_ns[robot]
            for robot, at_ns in ((m.receiver, m.stamp_ns), (m.transmitter, sent_ns))
        )

    log = inputs.wireless
    kept = tuple(m for m in log.measurements if not is_later(m))
    headings = tuple(h for h in log.headings if h.robot not in ends_ns or h.stamp_ns <= ends_ns[h.robot])
    later = len(log.measurements) - len(kept)
    if later and not kept:
        logger.warning(
            "all %d radio measurements are later than the %d scans that are read of each robot, and left out: whether"
            " their clock is off shows where more scans are read (-n)",
            later, inputs.limit,
        )  # fmt: skip
    elif later:
        logger.warning(
            "%d of %d radio measurements are later than the %d scans that are read of each robot; left out",
            later, len(log.measurements), inputs.limit,
        )  # fmt: skip
    return replace(inputs, wireless=WirelessLog(kept, headings))
