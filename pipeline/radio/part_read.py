"""Of recordings that are read in part (`-n`) the radio of that part counts: the rest of a log is no sign of a clock."""

from __future__ import annotations

import logging
from collections.abc import Mapping

from wiclosure.types import WirelessLog, WirelessMeasurement

logger = logging.getLogger(__name__)


def without_later(log: WirelessLog, ends_ns: Mapping[str, int], scans: int) -> WirelessLog:
    """Without what was measured after the last scan of a robot of which not all scans were to be read.

    Args:
        log: of all robots.
        ends_ns: stamp of the last scan that was read, of each robot that may have more.
        scans: how many were to be read of each.
    """

    def is_later(m: WirelessMeasurement) -> bool:
        sent_ns = m.stamp_ns if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns
        return any(
            robot in ends_ns and at_ns > ends_ns[robot]
            for robot, at_ns in ((m.receiver, m.stamp_ns), (m.transmitter, sent_ns))
        )

    kept = tuple(m for m in log.measurements if not is_later(m))
    headings = tuple(h for h in log.headings if h.robot not in ends_ns or h.stamp_ns <= ends_ns[h.robot])
    later = len(log.measurements) - len(kept)
    if later and not kept:
        logger.warning(
            "all %d radio measurements are later than the %d scans that are read of each robot, and left out: whether"
            " their clock is off shows where more scans are read (-n)",
            later, scans,
        )  # fmt: skip
    elif later:
        logger.warning(
            "%d of %d radio measurements are later than the %d scans that are read of each robot; left out",
            later, len(log.measurements), scans,
        )  # fmt: skip
    return WirelessLog(kept, headings)
