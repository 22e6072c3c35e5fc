"""What the filter does for each pair of robots, done by workers: alignments, diagnoses, searches for overlap."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TypeAlias, TypeVar

from wiclosure.types import FrameAlignment, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.alignment.align import align_together
from wiclosure.wiclosure_filter.config import AlignmentSettings, GateSettings
from wiclosure.wiclosure_filter.faults.corrections import Correction
from wiclosure.wiclosure_filter.faults.diagnosis import between, likeliest, tried, worth_a_diagnosis
from wiclosure.wiclosure_filter.links.links import Links
from wiclosure.wiclosure_filter.search.gates import make_gate
from wiclosure.wiclosure_filter.search.overlap_search import KeptPairs, find_overlap
from wiclosure.wiclosure_filter.search.pair_model import PairModel
from wiclosure.workers import ThisProcess, Workers

RobotPair: TypeAlias = tuple[str, str]
_Item = TypeVar("_Item")

_AT_ONCE = 16  # pairs of robots sent together: about a second's work
_WORTH_WORKERS = 64  # of fewer pairs the work is done sooner than processes start
_TRIED = 25  # alignments that a diagnosis makes


@dataclass(frozen=True, eq=False)
class _Team:
    """Links of some pairs of robots, and the trajectories that they need."""

    links: Sequence[Links]
    trajectories: Mapping[str, Trajectory]

    def __str__(self) -> str:
        first = self.links[0]
        return f"alignments of {len(self.links)} pairs of robots, the first {first.robot_a} and {first.robot_b}"


def alignments(
    links: Mapping[RobotPair, Links],
    trajectories: Mapping[str, Trajectory],
    settings: AlignmentSettings,
    workers: Workers,
) -> dict[RobotPair, FrameAlignment]:
    """Frame alignments of all pairs of robots that heard each other, in the order of `links`."""
    heard = [between for between in links.values() if between.heard]
    parts = []
    for part in batched(heard, _AT_ONCE):
        robots = {robot for between in part for robot in (between.robot_a, between.robot_b)}
        parts.append(_Team(part, {robot: trajectories[robot] for robot in trajectories if robot in robots}))
    with closing(_pool(workers, len(heard)).each(partial(_aligned, settings=settings), parts)) as done:
        found = dict(done)
    return {(one.robot_a, one.robot_b): one for number in range(len(parts)) for one in found[number]}


def _aligned(team: _Team, settings: AlignmentSettings) -> list[FrameAlignment]:
    return align_together([(links, team.trajectories) for links in team.links], settings)


@dataclass(frozen=True, eq=False)
class _Doubtful:
    """An alignment that measurements do not fit, with what it rests on."""

    alignment: FrameAlignment
    trajectories: Mapping[str, Trajectory]
    log: WirelessLog

    def __str__(self) -> str:
        return f"diagnosis of {self.alignment.robot_a} and {self.alignment.robot_b}"


def faults(
    alignments: Iterable[FrameAlignment],
    trajectories: Mapping[str, Trajectory],
    log: WirelessLog,
    settings: AlignmentSettings,
    workers: Workers,
) -> dict[RobotPair, Correction]:
    """The likeliest systematic error of each pair of robots whose measurements do not fit, where one explains them."""
    doubtful = {(one.robot_a, one.robot_b): one for one in alignments if worth_a_diagnosis(one)}
    logs = between(log, doubtful)
    work = [
        _Doubtful(one, {robot: trajectories[robot] for robot in pair}, logs[pair]) for pair, one in doubtful.items()
    ]
    with closing(_pool(workers, _TRIED * len(work)).each(partial(_diagnosed, settings=settings), work)) as done:
        found = dict(done)
    return {
        pair: tried(one.alignment, one.trajectories, one.log, settings)[0][best]
        for number, (pair, one) in enumerate(zip(doubtful, work, strict=True))
        if (best := found[number]) is not None
    }


def _diagnosed(doubtful: _Doubtful, settings: AlignmentSettings) -> int | None:
    return likeliest(doubtful.alignment, doubtful.trajectories, doubtful.log, settings)


def searches(
    models: Iterable[tuple[RobotPair, tuple[PairModel, ...]]], pairs: int, settings: GateSettings, workers: Workers
) -> Iterator[tuple[RobotPair, KeptPairs]]:
    """Pairs of keyframes that the gate keeps by any model of two robots.

    Args:
        models: of pairs of robots, made as they are asked for.
        pairs: how many pairs of robots there are.
        settings: of the gate.
        workers: who searches.
    """
    pool = _pool(workers, pairs)
    parts = batched(models, _AT_ONCE if pool.count > 1 else 1)
    with closing(pool.each(partial(_searched, settings=settings), parts, named=_searched_name)) as done:
        for _, found in done:
            yield from found


def _searched_name(part: Sequence[tuple[RobotPair, tuple[PairModel, ...]]]) -> str:
    return f"search for overlap of {len(part)} pairs of robots, the first {' and '.join(part[0][0])}"


def _searched(
    part: Sequence[tuple[RobotPair, tuple[PairModel, ...]]], settings: GateSettings
) -> list[tuple[RobotPair, KeptPairs]]:
    gate = make_gate(settings)
    return [(pair, KeptPairs.united([find_overlap(model, gate) for model in of_pair])) for pair, of_pair in part]


def batched(items: Iterable[_Item], size: int) -> Iterator[tuple[_Item, ...]]:
    """Successive items together, taken only as they are asked for."""
    left = iter(items)
    while part := tuple(islice(left, size)):
        yield part


def _pool(workers: Workers, pairs: int) -> Workers:
    return workers if pairs >= _WORTH_WORKERS else ThisProcess()
