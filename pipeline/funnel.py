"""The candidate funnel: how many pairs of keyframes are left after each stage, and how many of those are true.

Up to scan context a pair is a guess that two places are one: true where the keyframes are within the radius in which
scans overlap.  From registration on it is a measured relative pose: true where that is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wiclosure.pipeline.closure_quality import PASSED, ClosureJudge
from wiclosure.pipeline.metrics import CandidateMetrics, StageCount
from wiclosure.pipeline.trajectory_error import truth_at
from wiclosure.types import Closure, Decision, Trajectory

STAGES = ("pairs", "kept", "scan context", "registered", "PCM", "graph")


def funnel(
    candidates: CandidateMetrics,
    *,
    pairs_total: int,
    pairs_kept: int,
    verified: Sequence[Closure],
    consistent: Sequence[Closure],
    final: Sequence[Closure],
    truth: Mapping[str, Trajectory],
    judge: ClosureJudge,
) -> list[StageCount]:
    """Counts after each of `STAGES`.

    Args:
        candidates: kept pairs against those within the overlap radius.
        pairs_total: pairs of keyframes between robots.
        pairs_kept: those that the filter left.
        verified: every proposed closure as registration left it.
        consistent: the same as PCM left them.
        final: the same as the graph left them.
        truth: ground truth by robot; positions suffice.
        judge: tells which measured closures are true.
    """
    near = _near(verified, judge.keyframes, truth, candidates["radius_m"], judge.gap_s)
    measured = (
        [c for c in verified if c.decision in PASSED],
        [c for c in consistent if c.decision in PASSED],
        [c for c in final if c.decision is Decision.ACCEPTED],
    )
    rows = [
        (pairs_total, candidates["true"], candidates["false"]),
        (pairs_kept, candidates["kept_true"], candidates["kept_false"]),
        (len(verified), *near),
        *((len(closures), *judge.count(closures)) for closures in measured),
    ]
    return [
        {"stage": stage, "count": count, "true": true, "false": false}
        for stage, (count, true, false) in zip(STAGES, rows, strict=True)
    ]


def _near(
    closures: Sequence[Closure],
    keyframes: Mapping[str, Trajectory],
    truth: Mapping[str, Trajectory],
    radius_m: float,
    gap_s: float,
) -> tuple[int, int] | tuple[None, None]:
    """How many closures join places within the radius, and how many do not; None without ground truth."""
    places = {robot: truth_at(truth.get(robot), t.stamps_ns, gap_s) for robot, t in keyframes.items()}
    ends = [[places[k.robot][0][k.index, :3, 3] for k in (c.query, c.match)] for c in closures]
    covered = np.array([all(places[k.robot][1][k.index] for k in (c.query, c.match)) for c in closures], bool)
    if not covered.any() and (closures or not truth):
        return None, None
    place = np.array(ends).reshape(-1, 2, 3)
    near = np.linalg.norm(place[:, 0] - place[:, 1], axis=1) <= radius_m
    return int((near & covered).sum()), int((~near & covered).sum())
