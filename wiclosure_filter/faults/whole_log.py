"""What is wrong with a log is wrong with all of it: pairs of robots vote on its conventions and units.

Two robots that drive in parallel cannot tell reversed azimuths from right ones; two others can, with the same receiver
and the same author of the log.  And where most pairs say that azimuths are reversed, one that fits by chance is not
to be trusted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TypeAlias

from wiclosure.types import FrameAlignment
from wiclosure.wiclosure_filter.faults.corrections import Correction
from wiclosure.wiclosure_filter.links.links import Links

RobotPair: TypeAlias = tuple[str, str]


def outvoted(
    faults: Mapping[RobotPair, Correction], alignments: Mapping[RobotPair, FrameAlignment]
) -> dict[RobotPair, Correction]:
    """The faults of each pair once all pairs have voted on those of the whole log.

    A fault that more pairs name than are certain without it is that of the certain ones as well; of the others none
    is left.

    Args:
        faults: named for some pairs.
        alignments: of all pairs, by what the log claims.
    """
    certain = [pair for pair, alignment in alignments.items() if not alignment.ambiguous and pair not in faults]
    votes = Counter(fault.fault for fault in faults.values() if fault.whole_log)
    carried = {fault for fault, count in votes.items() if count > len(certain)}
    left = {pair: fault for pair, fault in faults.items() if not fault.whole_log or fault.fault in carried}
    if carried and certain:
        most = max(carried, key=votes.__getitem__)
        correction = next(fault for fault in faults.values() if fault.fault == most)
        left |= dict.fromkeys(certain, correction)
    return left


def without_refuted(
    alignments: Mapping[RobotPair, FrameAlignment],
    links: Mapping[RobotPair, Links],
    faults: Mapping[RobotPair, Correction],
) -> dict[RobotPair, FrameAlignment]:
    """Alignments that are certain after all, since other pairs rule out the blunders that would fit as well.

    All that receive between two robots must have received in a pair that is certain; and nobody names a fault of the
    whole log.
    """
    if any(fault.whole_log for fault in faults.values()):
        return {}
    certain = [pair for pair, alignment in alignments.items() if not alignment.ambiguous and pair not in faults]
    heard_rightly = set().union(*(_receivers(links[pair]) for pair in certain))
    found = {}
    for pair, alignment in alignments.items():
        if alignment.only_blunders and pair not in faults and _receivers(links[pair]) <= heard_rightly:
            found[pair] = alignment.certain_after_all("other robots rule out that the log is wrong")
    return found


def _receivers(links: Links) -> set[str]:
    return {links.robot_a if a_receives else links.robot_b for a_receives in set(links.a_receives.tolist())}
