"""Pairwise consistency maximisation: the largest set of closures that agree with each other and with odometry.

Mangelson et al., "Pairwise consistent measurement set maximization", ICRA 2018.  Two closures `z_ik`, `z_jl` of one
pair of robots and the odometry between their ends make a cycle; for true closures it differs from identity by noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.backends.closure_sets import ClosureSet, Verdict, closure_sets, decided
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency import PairGraph, doublings
from wiclosure.backends.judgement import PairConsistency, Verdicts, judge
from wiclosure.max_clique import max_clique
from wiclosure.types import Closure, FloatArray, Stage, Trajectory

ENLARGED = 1.1  # doubling sigma is right as long as it makes the consistent sets so many times larger,
ENLARGED_BY = 3  # and by so many closures: one or two more may be chance


@dataclass(frozen=True, slots=True, eq=False)
class PcmResult:
    """Closures with PCM's decision, in the order given, and what was found between each two robots.

    `scale` says by how much the stated standard deviations were enlarged (`PcmSettings.max_scale`).
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
            f"stated standard deviations are taken {self.scale:g} times as large: closures agree only so",
            *sentences,
        )


def pairwise_consistent(
    closures: Sequence[Closure], trajectories: Mapping[str, Trajectory], settings: PcmSettings
) -> PcmResult:
    """Accepts, for each pair of robots, the largest set of live closures that agree; rejects the others.

    Args:
        closures: any; those not measured yet, or rejected, pass through unchanged.
        trajectories: keyframe odometry by robot, with its drift model; each robot in its own frame.
        settings: see `PcmSettings`.

    Raises:
        InputError: a closure names a robot or a keyframe that the trajectories do not have.
    """
    pcm = IncrementalPcm(settings)
    pcm.add(closures, trajectories)
    return pcm.result()


class IncrementalPcm:
    """The same as closures arrive: one row of the matrix each, and the answer of all at once."""

    def __init__(self, settings: PcmSettings) -> None:
        self.settings = settings
        self._closures: list[Closure] = []
        self._unusable: dict[int, str] = {}
        self._graphs: dict[tuple[str, str], PairGraph] = {}
        self._sizes: dict[tuple[str, str], list[int]] = {}
        self._judged: dict[tuple[str, str], tuple[PairConsistency, Verdicts]] = {}
        self._level = 0

    def add(self, closures: Sequence[Closure], trajectories: Mapping[str, Trajectory]) -> None:
        """Takes more closures in.

        Args:
            closures: those that are new.
            trajectories: keyframe odometry of all robots; may have grown, but is otherwise that of all calls before.

        Raises:
            InputError: a closure names a robot or a keyframe that the trajectories do not have.
        """
        sets, unusable = closure_sets(closures, trajectories, self.settings.noise)
        sets = sets if self.settings.enabled else []
        self._unusable |= {row + len(self._closures): reason for row, reason in unusable.items()}
        changed = []
        for found in sets:
            z, pair = replace(found, rows=found.rows + len(self._closures)), (found.robot_a, found.robot_b)
            graph = self._graphs.get(pair)
            if graph is None:
                self._graphs[pair] = PairGraph.of(z, trajectories, self.settings)
            else:
                self._graphs[pair] = graph.grown(z, trajectories, self.settings)
            changed.append(pair)
        self._closures += closures
        self._judge(changed, trajectories)

    @property
    def believed_rows(self) -> frozenset[int]:
        """Positions of the accepted closures among all that were added; of all live ones without PCM."""
        if not self.settings.enabled:
            usable = set(range(len(self._closures))) - self._unusable.keys()
            return frozenset(row for row in usable if self._closures[row].live)
        return frozenset(row for _, vs in self._judged.values() for row, verdict in vs.items() if verdict.accepted)

    def result(self) -> PcmResult:
        """All closures with their decisions."""
        if not self.settings.enabled:
            return PcmResult(tuple(self._closures), ())
        decided_on = {row: Verdict(False, reason) for row, reason in self._unusable.items()}
        for _, verdicts in self._judged.values():
            decided_on |= verdicts
        closures = decided(self._closures, Stage.CONSISTENCY, decided_on)
        for graph in self._graphs.values():
            degrees = graph.consistent(self._level).sum(axis=1).tolist()
            for row, degree in zip(graph.z.rows[graph.alive(self._level)], degrees, strict=True):
                closures[row] = replace(closures[row], consistent_with=degree)
        return PcmResult(tuple(closures), tuple(report for report, _ in self._judged.values()), 2.0**self._level)

    def _judge(self, changed: Sequence[tuple[str, str]], trajectories: Mapping[str, Trajectory]) -> None:
        """Decides again on the pairs that changed, or on all if sigma is now taken larger or smaller."""
        before, self._level = self._level, self._fitting_level(changed)
        for pair in changed if self._level == before else list(self._graphs):
            self._judged[pair] = self._of_pair(self._graphs[pair], trajectories)

    def _fitting_level(self, changed: Sequence[tuple[str, str]]) -> int:
        """How often to double sigma: as long as all consistent sets together gain a tenth by it.

        With sigma too small, true closures disagree by the same factor everywhere and each doubling unites more of
        them; with sigma right, doubling it only adds what the quantile cut off, and what chance allows.
        """
        levels = range(doublings(self.settings) + 1)
        if len(levels) == 1:
            return 0
        for pair in changed:
            graphs = (self._graphs[pair].consistent(level) for level in levels)
            self._sizes[pair] = [len(max_clique(g, time_budget_s=self.settings.time_budget_s)) for g in graphs]
        united = (
            np.array([sizes for (a, b), sizes in self._sizes.items() if a != b]).reshape(-1, len(levels)).sum(axis=0)
        )
        gains = (united[1:] >= ENLARGED * united[:-1]) & (united[1:] >= united[:-1] + ENLARGED_BY)
        return int(np.argmin([*gains, False]))

    def _of_pair(self, graph: PairGraph, trajectories: Mapping[str, Trajectory]) -> tuple[PairConsistency, Verdicts]:
        alive = graph.alive(self._level)
        checked = graph.z.subset(alive)
        predicted = any(self._closures[row].prediction is not None for row in checked.rows)
        places = None if predicted else _places(checked, trajectories)
        report, verdicts = judge(checked, graph.consistent(self._level), places, self.settings)
        stray = set(graph.z.rows.tolist()) - set(checked.rows.tolist())
        return report, verdicts | dict.fromkeys(stray, Verdict(False, "contradicts the robot's own odometry"))


def _places(z: ClosureSet, trajectories: Mapping[str, Trajectory]) -> FloatArray:
    """Positions `(2, N, 3)` of the closures' ends, each in its robot's odometry frame."""
    ends = ((z.robot_a, z.index_a), (z.robot_b, z.index_b))
    return np.stack([trajectories[robot].positions[index] for robot, index in ends])
