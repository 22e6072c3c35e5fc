"""What the filter says of closures once their poses are measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wiclosure.types import Closure, Decision, FilterResult


def unless_filter_objects(closures: Sequence[Closure], filtered: FilterResult) -> list[Closure]:
    """The same closures; verified ones whose measured pose contradicts what the filter knows are rejected."""
    checked = list(closures)
    for pair, check in filtered.checks.items():
        rows = [
            row
            for row, closure in enumerate(closures)
            if closure.decision is Decision.VERIFIED and (closure.query.robot, closure.match.robot) == pair
        ]
        if not rows:
            continue
        own = [closures[row] for row in rows]
        objections = check.objections(
            np.stack([closure.T_query_match for closure in own]),
            np.stack([closure.covariance for closure in own]),
            np.array([closure.query.index for closure in own]),
            np.array([closure.match.index for closure in own]),
        )
        for row, objection in zip(rows, objections, strict=True):
            if objection:
                checked[row] = replace(closures[row], decision=Decision.REJECTED, reason=objection)
    return checked
