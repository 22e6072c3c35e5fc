"""All robots merged, although odometry of some may err steadily or jump."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.backends.closure_sets import ClosureSet
from wiclosure.backends.consistency.explanation import Explanation
from wiclosure.backends.consistency.merging import MergedGroups, cost_of_rejected, settled_within
from wiclosure.backends.consistency.odometry_jumps import JumpDecisions, merge_despite_jumps
from wiclosure.backends.consistency.scale import allowed
from wiclosure.backends.consistency.steady_errors import steady_errors
from wiclosure.backends.least_squares.edges import DEGREES
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.backends.odometry_jump import OdometryJump
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.sigma_scale import of_residuals
from wiclosure.backends.steady_error import SteadyError
from wiclosure.types import BoolArray, FloatArray, Trajectory

ROUNDS = 8  # of correction: each is a step of Gauss-Newton, and closures that the one before admits tell more
RESCALED = 2  # times, until scale and estimate belong together


@dataclass(frozen=True, eq=False)
class Measured:
    """What robots measured.

    Args:
        trajectories: odometry.
        sets: closures.
        predicted: those that a prediction supports, by row of the list that they came from.
    """

    trajectories: Mapping[str, Trajectory]
    sets: Sequence[ClosureSet]
    predicted: BoolArray

    def corrected(self, errors: Sequence[SteadyError]) -> dict[str, Trajectory]:
        """Odometry without steady errors."""
        of = {error.robot: error.corrected(self.trajectories[error.robot]) for error in errors}
        return dict(self.trajectories) | of

    def team(self, errors: Sequence[SteadyError] = ()) -> TeamArrays:
        """The same as arrays."""
        return TeamArrays.of(self.corrected(errors), self.sets, self.predicted)


@dataclass(frozen=True, eq=False)
class DespiteErrors:
    """What came of it.

    Args:
        team: arrays, of odometry without steady errors.
        decisions: on closures.
        steady: errors that odometry is corrected by.
        open_steady: such that would lower the cost, but are larger than odometry errs.
        jumps, open_jumps: `JumpDecisions.believed` and `JumpDecisions.open`.
    """

    team: TeamArrays
    decisions: JumpDecisions
    steady: tuple[SteadyError, ...]
    open_steady: tuple[SteadyError, ...]
    jumps: tuple[OdometryJump, ...]
    open_jumps: tuple[OdometryJump, ...]


def merge_despite_errors(measured: Measured, team: TeamArrays, settings: MergeSettings) -> DespiteErrors:
    """As odometry is or, where that explains much more, without steady errors; jumps are looked for in both.

    Args:
        measured: by the robots.
        team: the same as arrays.
        settings: of the merge.
    """
    as_it_is = _Corrected(team, Explanation.of(team.robots, settings))
    steadied = _without_steady_errors(measured, as_it_is, settings)
    best, decisions = as_it_is, merge_despite_jumps(as_it_is.explanation, settings)
    too_large: tuple[SteadyError, ...] = ()
    if steadied.steady:
        without = merge_despite_jumps(steadied.explanation, settings)
        if without.cost + cost_of_rejected(team.robots, settings) < decisions.cost:
            too_large = tuple(error for error in steadied.steady if not error.plausible)
            if not too_large:
                best, decisions = steadied, without
    odometry = measured.corrected(best.steady)
    jumps, left_open = (
        tuple(OdometryJump.of_team(best.team, jump, odometry) for jump in of)
        for of in (decisions.believed, decisions.open)
    )
    return DespiteErrors(best.team, decisions, best.steady, too_large, jumps, left_open)


@dataclass(frozen=True, eq=False)
class _Corrected:
    """A team without some errors of its odometry, merged."""

    team: TeamArrays
    explanation: Explanation
    steady: tuple[SteadyError, ...] = ()

    def again(self, measured: Measured, settings: MergeSettings) -> _Corrected | None:
        """Without the errors that its estimate shows; None where it shows none.

        Errors are taken away as long as the same closures show more: under the scale of sigma that these ask for then.
        """
        team, steady = self.team, {error.robot: error.per_m for error in self.steady}
        merged, restated = self.explanation.merged, self.explanation.restated
        for _ in range(ROUNDS):
            left = steady_errors(team, restated, merged, measured.corrected(_named(steady)))
            if not left:
                break
            for robot, per_m in left.items():
                steady[robot] = steady.get(robot, np.zeros(DEGREES)) + per_m
            team = measured.team(_named(steady))
            merged, restated = _without_decisions(team.robots, merged, settings)
        if team is self.team:
            return None
        return _Corrected(team, Explanation.of(team.robots, settings), _named(steady))


def _named(steady: Mapping[str, FloatArray]) -> tuple[SteadyError, ...]:
    return tuple(SteadyError(robot, steady[robot]) for robot in sorted(steady))


def _without_decisions(robots: Robots, merged: MergedGroups, settings: MergeSettings) -> tuple[MergedGroups, Robots]:
    """The estimate by the same closures under the scale that they ask for, and robots restated by it."""
    for _ in range(RESCALED):
        restated = merged.restated(robots)
        settled = settled_within(restated, merged.group, merged.inlier, merged.settled.poses, np.inf)
        asked = of_residuals(settled.redundant, robots.degrees) or 1.0
        scale = float(merged.factors.max())
        change = allowed(scale * asked, settings) / scale
        merged = replace(merged, settled=settled, factors=merged.factors * change)
        if change == 1.0:
            break
    return merged, merged.restated(robots)


def _without_steady_errors(measured: Measured, found: _Corrected, settings: MergeSettings) -> _Corrected:
    """Corrected as long as that lowers the cost."""
    for _ in range(ROUNDS):
        tried = found.again(measured, settings)
        if tried is None or tried.explanation.cost(settings) >= found.explanation.cost(settings):
            break
        found = tried
    return found
