"""The candidate funnel: how many pairs of keyframes are left after each stage, and how many of those are true.

Up to scan context a pair is a guess that two places are one: true where the keyframes are within the radius in which
scans overlap.  From registration on it is a measured relative pose: true where that is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from wiclosure.pipeline.evaluation.closures import TruthCheck
from wiclosure.pipeline.evaluation.metrics import CandidateMetrics, StageCount
from wiclosure.types import Closure, FilterResult, Stage, Trajectory, survivors

MEASURED = {
    "registered": Stage.REGISTRATION,
    "radio check": Stage.RADIO_CHECK,
    "PCM": Stage.CONSISTENCY,
    "graph": Stage.ESTIMATE,
}
STAGES = ("pairs", "kept", "scan context", *MEASURED)


def funnel(
    candidates: CandidateMetrics,
    filtered: FilterResult,
    closures: Sequence[Closure],
    truth: Mapping[str, Trajectory],
    truth_check: TruthCheck,
) -> list[StageCount]:
    """Counts after each of `STAGES`.

    Args:
        candidates: kept pairs against those within the overlap radius.
        filtered: what the filter left.
        closures: every proposed closure with its final decision.
        truth: ground truth by robot; positions suffice.
        truth_check: tells which measured closures are true.
    """
    near = truth_check.near(closures, truth, candidates["radius_m"])
    left = [survivors(closures, stage) for stage in MEASURED.values()]
    rows = [
        (filtered.pairs_total, candidates["true"], candidates["false"]),
        (filtered.pairs_kept, candidates["kept_true"], candidates["kept_false"]),
        (len(closures), *near),
        *((len(survived), *truth_check.count(survived)) for survived in left),
    ]
    return [
        {"stage": stage, "count": count, "true": true, "false": false}
        for stage, (count, true, false) in zip(STAGES, rows, strict=True)
    ]
