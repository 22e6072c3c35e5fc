"""The radio consistency check: measured poses held against what the filter knows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wiclosure.types import Closure, ClosureCheck, Stage, measured_poses


def radio_checked(closures: Sequence[Closure], checks: Mapping[tuple[str, str], ClosureCheck]) -> list[Closure]:
    """The closures as the radio check leaves them.

    Args:
        closures: in any order; those that are not live stay as they are.
        checks: by robots of query and match; what no check covers passes.
    """
    objections: dict[int, str] = {}
    for pair, check in checks.items():
        rows = [
            row
            for row, closure in enumerate(closures)
            if closure.live and (closure.query.robot, closure.match.robot) == pair
        ]
        if rows:
            own = [closures[row] for row in rows]
            index_a, index_b = np.array([(closure.query.index, closure.match.index) for closure in own]).T
            objections |= zip(rows, check.objections(*measured_poses(own), index_a, index_b), strict=True)
    return [
        _checked(closure, objections.get(row, "")) if closure.live else closure for row, closure in enumerate(closures)
    ]


def _checked(closure: Closure, objection: str) -> Closure:
    return closure.rejected(Stage.RADIO_CHECK, objection) if objection else closure.accepted(Stage.RADIO_CHECK)
