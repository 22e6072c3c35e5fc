"""The candidate funnel: how many pairs of keyframes are left after each stage, and how many of those are true.

Up to scan context a pair is a guess that two places are one: true where the keyframes are within the radius in which
scans overlap.  From registration on it is a measured relative pose: true where that is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from wiclosure.pipeline.evaluation.closures import PASSED, ClosureJudge
from wiclosure.pipeline.evaluation.metrics import CandidateMetrics, StageCount
from wiclosure.types import Closure, Decision, FilterResult, Trajectory

STAGES = ("pairs", "kept", "scan context", "registered", "radio", "PCM", "graph")


def funnel(
    candidates: CandidateMetrics,
    filtered: FilterResult,
    *,
    registered: Sequence[Closure],
    verified: Sequence[Closure],
    consistent: Sequence[Closure],
    final: Sequence[Closure],
    truth: Mapping[str, Trajectory],
    judge: ClosureJudge,
) -> list[StageCount]:
    """Counts after each of `STAGES`.

    Args:
        candidates: kept pairs against those within the overlap radius.
        filtered: what the filter left.
        registered: every proposed closure as registration left it.
        verified: the same as the filter's check of their poses left them.
        consistent: the same as PCM left them.
        final: the same as the graph left them.
        truth: ground truth by robot; positions suffice.
        judge: tells which measured closures are true.
    """
    near = judge.near(registered, truth, candidates["radius_m"])
    measured = (
        [c for c in registered if c.decision in PASSED],
        [c for c in verified if c.decision in PASSED],
        [c for c in consistent if c.decision in PASSED],
        [c for c in final if c.decision is Decision.ACCEPTED],
    )
    rows = [
        (filtered.pairs_total, candidates["true"], candidates["false"]),
        (filtered.pairs_kept, candidates["kept_true"], candidates["kept_false"]),
        (len(registered), *near),
        *((len(closures), *judge.count(closures)) for closures in measured),
    ]
    return [
        {"stage": stage, "count": count, "true": true, "false": false}
        for stage, (count, true, false) in zip(STAGES, rows, strict=True)
    ]
