"""Pairs of keyframes that a log had pruned, looked at once the merged map refutes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from wiclosure.frontends.place_recognition.matching import MatchResult
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages import attempts, solve
from wiclosure.pipeline.stages.attempts import Attempt, Attempts
from wiclosure.types import CandidatePairs, Closure, FilterResult, KeyframeId, Measured, Stage, Trajectory

PAIR = ("a", "b")
MEASURED = Measured(np.eye(4), np.eye(6))


def path(robot: str) -> Trajectory:
    return Trajectory(robot, np.arange(3) * 10**9, np.tile(np.eye(4), (3, 1, 1)))


def closure(a: int, b: int, *, live: bool) -> Closure:
    found = Closure(KeyframeId("a", a), KeyframeId("b", b), passed=Stage.REGISTRATION, measured=MEASURED)
    return found.accepted(Stage.RADIO_CHECK) if live else found.rejected(Stage.RADIO_CHECK, "contradicts the radio")


@dataclass
class Pool:
    """Registers all that is proposed."""

    proposed: list[tuple[int, int]] = field(default_factory=list)

    def register(self, proposed: Sequence[Closure], _: object) -> tuple[list[Closure], float]:
        self.proposed += [(c.query.index, c.match.index) for c in proposed]
        return [Closure(c.query, c.match, passed=Stage.REGISTRATION, measured=MEASURED) for c in proposed], 0.0


@pytest.fixture
def pool(monkeypatch: pytest.MonkeyPatch) -> Pool:
    def alike(candidates: Sequence[CandidatePairs], *_: object) -> tuple[MatchResult, ...]:
        """All of them."""
        (one,) = candidates
        ends = zip(one.index_a.tolist(), one.index_b.tolist(), strict=True)
        proposed = tuple(Closure(KeyframeId(one.robot_a, a), KeyframeId(one.robot_b, b)) for a, b in ends)
        return (MatchResult(proposed, *[len(one)] * 5),)

    monkeypatch.setattr(attempts, "_match", alike)
    return Pool()


def attempt(kept: int) -> Attempt:
    """With one closure that is live, and one that the radio had refused."""
    pairs = CandidatePairs.without_prediction(*PAIR, *np.divmod(np.arange(kept), 3))
    closures = closure(0, 0, live=True), closure(0, 1, live=False)
    return Attempt(FilterResult("wiclosure", (pairs,), 9), (), closures, closures)


def looked_at(pool: Pool, kept: int, refuted: Sequence[tuple[str, str]]) -> tuple[Attempt, Attempt]:
    keyframes = {robot: path(robot) for robot in PAIR}
    all_of_it = Attempts({}, keyframes, None, Config(), pool, NoProgress(), None)  # type: ignore[arg-type]
    given = attempt(kept)
    return given, all_of_it.unpruned(given, refuted)


def test_pairs_that_a_refuted_log_had_pruned_or_refused_are_looked_at(pool: Pool) -> None:
    _, found = looked_at(pool, 4, [PAIR])
    assert sorted(pool.proposed) == [(a, b) for a in range(3) for b in range(3) if (a, b) != (0, 0)]
    assert sorted((c.query.index, c.match.index) for c in found.closures) == [
        (a, b) for a in range(3) for b in range(3)
    ]
    assert all(c.live and c.passed is Stage.RADIO_CHECK for c in found.closures)


@pytest.mark.parametrize(("kept", "refuted"), [(9, [PAIR]), (4, [])])
def test_nothing_is_looked_at_again_where_nothing_was_pruned_or_refuted(
    pool: Pool, kept: int, refuted: Sequence[tuple[str, str]]
) -> None:
    given, found = looked_at(pool, kept, refuted)
    assert found is given
    assert pool.proposed == []


@pytest.mark.parametrize(("accepted", "taken"), [([0, 1, 2], True), ([0, 2], True), ([3, 4, 5], False)])
def test_a_map_that_what_was_pruned_would_turn_over_stays(
    monkeypatch: pytest.MonkeyPatch, accepted: list[int], taken: bool
) -> None:
    def estimate(rows: Sequence[int]) -> SimpleNamespace:
        graph = SimpleNamespace(accepted=[closure(n, n, live=True) for n in rows])
        agreed = SimpleNamespace(attempt="pruned", checks=())
        return SimpleNamespace(graph=graph, by_map=SimpleNamespace(contradicted={PAIR: None}), agreed=agreed)

    found, wider = estimate([0, 1]), estimate(accepted)
    monkeypatch.setattr(solve, "_agreeing", lambda *_: None)
    monkeypatch.setattr(solve, "_merged", lambda *_: wider)
    looked = SimpleNamespace(unpruned=lambda *_: "whole")
    chosen = solve._widened(looked, found, None, None, None)  # type: ignore[arg-type]
    assert chosen is (wider if taken else found)
