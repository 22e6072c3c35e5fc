"""Which closures are consistent with each other and with odometry, at once or as they arrive."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wiclosure.backends.closure_sets import ClosureSet, Decision, closure_sets, decided
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.clique import chi_square_limit, largest_clique
from wiclosure.backends.consistency.despite_errors import Measured, merge_despite_errors
from wiclosure.backends.consistency.merging import MergedGroups
from wiclosure.backends.consistency.neighbouring_closures import robots_in_contradiction
from wiclosure.backends.consistency.pair_report import PairConsistency, doubt_of_neighbours
from wiclosure.backends.consistency.rival_sets import rivals
from wiclosure.backends.consistency.unchecked_loops import unchecked
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.backends.odometry_jump import OdometryJump
from wiclosure.backends.sets.candidate_sets import CandidateSet
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.sigma_scale import least
from wiclosure.backends.steady_error import SteadyError
from wiclosure.blas import one_blas_thread
from wiclosure.types import Closure, IntArray, Stage, Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class PcmResult:
    """Closures as the consistency check leaves them, in the order given, and what was found between each two robots.

    Args:
        closures: accepted or rejected with a reason.
        pairs: one report for each two robots that closures connect, and for each robot that they close.
        scale: how many times the stated standard deviations are taken (`PcmSettings.max_scale`).
        basis: the estimate that the decisions rest on, where `method: groups` made one.
        jumps: steps of odometry that closures contradict, which are not believed.
        open_jumps: those that would explain what closures say as well as false closures do; odometry is believed.
        steady_errors: of odometry, which closures tell of; it is corrected.
        open_steady_errors: those that would explain what closures say, but are larger than odometry errs.
        contradictory: two robots, or one twice, between which accepted closures contradict their neighbours.
        unchecked: share of loops at any places that would be accepted within a robot, by robot of which that is most.
    """

    closures: tuple[Closure, ...]
    pairs: tuple[PairConsistency, ...]
    scale: float = 1.0
    basis: tuple[TeamArrays, MergedGroups] | None = None
    jumps: tuple[OdometryJump, ...] = ()
    open_jumps: tuple[OdometryJump, ...] = ()
    steady_errors: tuple[SteadyError, ...] = ()
    open_steady_errors: tuple[SteadyError, ...] = ()
    contradictory: tuple[str, str] | None = None
    unchecked: Mapping[str, float] = field(default_factory=dict)

    @property
    def odometry_factors(self) -> dict[str, float]:
        """How many times larger than stated the errors of odometry are taken, by robot, where other than once."""
        if self.basis is None:
            return {}
        team, merged = self.basis
        factors = zip(team.names, merged.odometry_factors.tolist(), strict=False)
        return {robot: factor for robot, factor in factors if factor != 1}

    def restated(self, trajectories: Mapping[str, Trajectory]) -> dict[str, Trajectory]:
        """Odometry without the errors found, with standard deviations as they are taken, the common `scale` aside."""
        factors, found = self.odometry_factors, dict(trajectories)
        for error in self.steady_errors:
            found[error.robot] = error.corrected(found[error.robot])
        found |= {robot: found[robot].loosened(factor) for robot, factor in factors.items()}
        for jump in self.jumps:
            found[jump.robot] = found[jump.robot].loosened_step(jump.index, jump.covariance)
        return found

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences for sets of closures that contradict each other, one accepted, jumps, loops that nothing checks."""
        of_pairs = [pair.doubt for pair in self.pairs if pair.doubt]
        if self.contradictory:
            of_pairs.append(doubt_of_neighbours(*self.contradictory))
        of_loops = tuple(
            f"{robot}: the map may be wrong: closures within its path are accepted, but its odometry is taken so"
            f" vaguely that {share:.0%} of false ones would be too; state its covariances"
            for robot, share in self.unchecked.items()
        )
        of_jumps, of_steady = ([error.doubt for error in of] for of in (self.open_jumps, self.open_steady_errors))
        return (*of_pairs, *of_jumps, *of_steady, *of_loops)

    @property
    def in_doubt(self) -> set[tuple[str, str]]:
        """The robots of the doubts."""
        return {(pair.robot_a, pair.robot_b) for pair in self.pairs if pair.doubt}

    @property
    def diagnosis(self) -> tuple[str, ...]:
        """All of it, the `doubts` first."""
        return (*self.doubts, *self.remarks)

    @property
    def remarks(self) -> tuple[str, ...]:
        """One sentence for each pair of robots."""
        sentences = tuple(jump.sentence for jump in self.jumps) + tuple(e.sentence for e in self.steady_errors)
        sentences += tuple(
            f"the odometry of {robot} errs {'more' if factor > 1 else 'less'} than it states: its standard deviations"
            f" are taken {factor:.2g} times as large, so its own loops agree"
            for robot, factor in self.odometry_factors.items()
        )
        sentences += tuple(pair.sentence for pair in self.pairs)
        if self.scale == 1:
            return sentences
        return (
            f"stated standard deviations are taken {self.scale:.2g} times as large: so odometry and closures agree",
            *sentences,
        )

    def sets_in_doubt(self, fewest: int) -> list[list[IntArray]]:
        """Of each two robots, sets of closures that contradict each other and are within a factor of two in size.

        Args:
            fewest: closures of a set, below which it puts nothing in doubt.

        Returns:
            Rows of the closures of each set, the largest first; nothing under `method: published`.
        """
        if self.basis is None:
            return []
        team, merged = self.basis
        found: defaultdict[tuple[int, int], list[IntArray]] = defaultdict(list)
        for candidate in sorted(merged.candidates, key=len, reverse=True):
            if len(candidate) >= fewest and not candidate.refutation:
                found[candidate.a, candidate.b].append(team.rows[candidate.rows])
        alike = ([rows for rows in sets if 2 * len(rows) >= len(sets[0])] for sets in found.values())
        return [sets for sets in alike if len(sets) > 1]


@one_blas_thread
def pairwise_consistent(
    closures: Sequence[Closure],
    trajectories: Mapping[str, Trajectory],
    settings: PcmSettings | None = None,
    supported: Collection[int] = (),
) -> PcmResult:
    """Accepts live closures that agree with each other and with odometry; rejects the others.

    Args:
        closures: any; those not measured yet, or rejected, pass through unchanged.
        trajectories: keyframe odometry by robot, with its drift model; each robot in its own frame.
        settings: defaults where None.
        supported: rows of closures that other evidence speaks for, as it does for those that were predicted: a set of
            them may come from one place.

    Raises:
        InputError: a closure names a robot or a keyframe that the trajectories do not have.
    """
    settings = settings or PcmSettings()
    if not settings.enabled:
        closure_sets(closures, trajectories, settings.noise)  # names unknown robots and keyframes
        return PcmResult(tuple(closures), ())
    sets, unusable = closure_sets(closures, trajectories, settings.noise)
    decisions = {row: Decision(False, reason) for row, reason in unusable.items()}
    if settings.published:
        found = [largest_clique(closure_set, trajectories, settings) for closure_set in sets]
        for _, of_pair in found:
            decisions |= of_pair
        checked = decided(closures, Stage.CONSISTENCY, decisions)
        return PcmResult(tuple(_with_support(checked, sets, decisions)), tuple(report for report, _ in found))
    if not sets:
        return PcmResult(tuple(decided(closures, Stage.CONSISTENCY, decisions)), ())
    predicted = np.array([c.prediction is not None or row in supported for row, c in enumerate(closures)])
    measured = Measured(trajectories, sets, predicted)
    team = measured.team()
    of_merge = merge_settings(settings, team.robots.degrees)
    despite = merge_despite_errors(measured, team, of_merge)
    team, merged = despite.team, despite.decisions.merged
    for n, (row, inlier) in enumerate(zip(team.rows.tolist(), merged.inlier.tolist(), strict=True)):
        decisions[row] = Decision(inlier, "agrees with the others" if inlier else merged.reason[n])
    checked = _with_support(decided(closures, Stage.CONSISTENCY, decisions), sets, decisions)
    of_pair_sets: defaultdict[tuple[int, int], list[CandidateSet]] = defaultdict(list)
    for candidate in sorted(merged.candidates, key=len, reverse=True):
        of_pair_sets[candidate.a, candidate.b].append(candidate)
    rival, pairs = rivals(merged.candidates, merged.inlier), [_pair(z, team) for z in sets]
    reports = tuple(
        _report(z, of_pair_sets[pair], decisions, rival.get(pair, 0)) for z, pair in zip(sets, pairs, strict=True)
    )
    vague = {team.names[robot]: share for robot, share in unchecked(team.robots, merged, of_merge).items()}
    contradictory = robots_in_contradiction(team, merged, despite.decisions.believed)
    basis, errors = (team, merged), (despite.jumps, despite.open_jumps, despite.steady, despite.open_steady)
    return PcmResult(tuple(checked), reports, merged.scale, basis, *errors, contradictory, vague)


def merge_settings(settings: PcmSettings, degrees: int = 6) -> MergeSettings:
    """In the merge's own terms, for measurements of so many degrees of freedom."""
    return MergeSettings(
        agree_limit=chi_square_limit(settings.probability, degrees),
        probability=settings.probability,
        ambiguous_share=settings.ambiguous_share,
        min_size=settings.min_clique_size,
        most_scale=settings.max_scale,
        least_scale=least(settings.max_scale),
        view_steps=settings.view_keyframes,
    )


def _pair(closure_set: ClosureSet, team: TeamArrays) -> tuple[int, int]:
    """Numbers of its robots, the lower first."""
    one, other = (team.names.index(robot) for robot in (closure_set.robot_a, closure_set.robot_b))
    return min(one, other), max(one, other)


def _report(
    closure_set: ClosureSet, found: Sequence[CandidateSet], decisions: Mapping[int, Decision], rival: int
) -> PairConsistency:
    """Of one pair of robots, or of one robot, from the sets found there, largest first."""
    sizes = [*map(len, found), 0, 0]
    kept = sum(decisions[row].accepted for row in closure_set.rows.tolist())
    objections = [c.refutation or c.objection for c in found if c.refutation or c.objection]
    if kept:
        said = f"{kept} of {len(closure_set)} closures agree and are accepted"
    elif len(closure_set) == 1:
        said = "a single closure cannot be checked"
    else:
        said = objections[0] if objections else f"no two of the {len(closure_set)} closures agree"
    ambiguous = not kept and bool(objections) and objections[0].startswith("ambiguous")
    return PairConsistency(
        closure_set.robot_a, closure_set.robot_b, len(closure_set), kept, sizes[0], sizes[1], proven=True,
        ambiguous=ambiguous, sentence=f"{closure_set.name}: {said}", rival=rival,
    )  # fmt: skip


def _with_support(
    closures: Sequence[Closure], sets: Sequence[ClosureSet], decisions: Mapping[int, Decision]
) -> list[Closure]:
    """With the number of other accepted closures of the same pair of robots, for those accepted."""
    found = list(closures)
    for closure_set in sets:
        inside = [row for row in closure_set.rows.tolist() if decisions[row].accepted]
        for row in inside:
            found[row] = replace(found[row], consistent_with=len(inside) - 1)
    return found
