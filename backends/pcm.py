"""Which closures are consistent with each other and with odometry, at once or as they arrive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.backends.clique import chi_square_limit, largest_clique
from wiclosure.backends.closure_sets import ClosureSet, Verdict, closure_sets, decided
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.merging import Merged, MergeSettings, merge
from wiclosure.backends.pair_report import PairConsistency
from wiclosure.backends.team_arrays import TeamArrays
from wiclosure.types import Closure, Stage, Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class PcmResult:
    """Closures as the consistency check leaves them, in the order given, and what was found between each two robots.

    `scale` says how many times the stated standard deviations are taken (`PcmSettings.max_scale`).
    """

    closures: tuple[Closure, ...]
    pairs: tuple[PairConsistency, ...]
    scale: float = 1.0

    @property
    def diagnosis(self) -> tuple[str, ...]:
        """One sentence for each pair of robots."""
        sentences = tuple(pair.sentence for pair in self.pairs)
        if self.scale == 1:
            return sentences
        return (
            f"stated standard deviations are taken {self.scale:.2g} times as large: so odometry and closures agree",
            *sentences,
        )


def pairwise_consistent(
    closures: Sequence[Closure], trajectories: Mapping[str, Trajectory], settings: PcmSettings
) -> PcmResult:
    """Accepts live closures that agree with each other and with odometry; rejects the others.

    Args:
        closures: any; those not measured yet, or rejected, pass through unchanged.
        trajectories: keyframe odometry by robot, with its drift model; each robot in its own frame.
        settings: see `PcmSettings`.

    Raises:
        InputError: a closure names a robot or a keyframe that the trajectories do not have.
    """
    if not settings.enabled:
        closure_sets(closures, trajectories, settings.noise)  # names unknown robots and keyframes
        return PcmResult(tuple(closures), ())
    sets, unusable = closure_sets(closures, trajectories, settings.noise)
    verdicts = {row: Verdict(False, reason) for row, reason in unusable.items()}
    reports: list[PairConsistency] = []
    scale = 1.0
    if settings.published:
        for z in sets:
            report, of_pair = largest_clique(z, trajectories, settings)
            reports.append(report)
            verdicts |= of_pair
    elif sets:
        predicted = np.array([c.prediction is not None for c in closures])
        team = TeamArrays.of(trajectories, sets, predicted)
        merged = merge(team.robots, merge_settings(settings))
        scale = merged.scale
        accepted = dict(zip(team.rows.tolist(), merged.inlier.tolist(), strict=True))
        reasons = {int(team.rows[n]): reason for n, reason in merged.reason.items()}
        reports = [_report(z, team, merged, accepted) for z in sets]
        verdicts |= {row: _verdict(row, accepted, reasons) for row in accepted}
    found = decided(closures, Stage.CONSISTENCY, verdicts)
    return PcmResult(tuple(_with_support(found, sets, verdicts)), tuple(reports), scale)


def merge_settings(settings: PcmSettings) -> MergeSettings:
    """In the merge's own terms."""
    return MergeSettings(
        agree_limit=chi_square_limit(settings.probability),
        probability=settings.probability,
        rival_share=settings.rival_share,
        min_size=settings.min_clique_size,
        most_scale=settings.max_scale,
    )


def _verdict(row: int, accepted: Mapping[int, bool], reasons: Mapping[int, str]) -> Verdict:
    return Verdict(True, "agrees with the others") if accepted[row] else Verdict(False, reasons[row])


def _report(z: ClosureSet, team: TeamArrays, merged: Merged, accepted: Mapping[int, bool]) -> PairConsistency:
    """Of one pair of robots, or of one robot."""
    a, b = sorted((team.names.index(z.robot_a), team.names.index(z.robot_b)))
    own = [c for c in merged.candidates if (c.a, c.b) == (a, b)]
    sizes = sorted((len(c) for c in own), reverse=True) + [0, 0]
    kept = sum(accepted[row] for row in z.rows.tolist())
    doubts = [c.fallen or c.doubt for c in sorted(own, key=len, reverse=True) if c.fallen or c.doubt]
    if kept:
        said = f"{kept} of {len(z)} closures agree and are accepted"
    elif len(z) == 1:
        said = "a single closure cannot be checked"
    else:
        said = doubts[0] if doubts else f"no two of the {len(z)} closures agree"
    ambiguous = not kept and bool(doubts) and doubts[0].startswith("ambiguous")
    return PairConsistency(
        z.robot_a, z.robot_b, len(z), kept, sizes[0], sizes[1], proven=True, ambiguous=ambiguous,
        sentence=f"{z.name}: {said}",
    )  # fmt: skip


def _with_support(
    closures: Sequence[Closure], sets: Sequence[ClosureSet], verdicts: Mapping[int, Verdict]
) -> list[Closure]:
    """With the number of other accepted closures of the same pair of robots, for those accepted."""
    found = list(closures)
    for z in sets:
        inside = [row for row in z.rows.tolist() if verdicts[row].accepted]
        for row in inside:
            found[row] = replace(found[row], consistent_with=len(inside) - 1)
    return found
