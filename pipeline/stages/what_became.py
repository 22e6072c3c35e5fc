"""Sentences on what became of the closures of a run: loops, lost candidates, nothing to merge."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.place_recognition.matching import MatchResult
from wiclosure.types import Closure, FilterResult, Stage, survivors

_FIGURES = re.compile(r"-?\d[\d.,^]*")


def own_loops(closures: Sequence[Closure]) -> tuple[str, ...]:
    """A sentence for each robot that came back to where it had been."""
    own: dict[str, list[Closure]] = {}
    for closure in closures:
        if closure.query.robot == closure.match.robot:
            own.setdefault(closure.query.robot, []).append(closure)
    return tuple(
        f"{robot}: of {len(found)} proposed loops within its own path {len(survivors(found, Stage.REGISTRATION))} were"
        f" registered and {len(survivors(found, Stage.ESTIMATE))} accepted"
        for robot, found in own.items()
    )


def nothing_to_merge(fronts: Mapping[str, FrontEndResult], closures: Sequence[Closure]) -> tuple[str, ...]:
    """A sentence where there is one robot that never came back."""
    if len(fronts) > 1 or survivors(closures, Stage.ESTIMATE):
        return ()
    return (
        "there is one robot only and no loop within its path, so there is nothing to merge: its map is that of plain"
        " odometry",
    )


def nothing_left(
    filtered: FilterResult, matched: Sequence[MatchResult], closures: Sequence[Closure]
) -> tuple[str, ...]:
    """Where the candidates were lost, said when nothing reached the graph."""
    registered, checked, estimated = (
        len(survivors(closures, stage)) for stage in (Stage.REGISTRATION, Stage.RADIO_CHECK, Stage.ESTIMATE)
    )
    if estimated or not filtered.pairs:
        return ()
    reasons = [closure.reason for closure in closures if closure.rejected_at is not None]
    kinds = Counter(_FIGURES.sub("", reason) for reason in reasons)
    usual = next((r for r in reasons if _FIGURES.sub("", r) == kinds.most_common(1)[0][0]), "")
    often = f"; for example: {usual}" if usual else ""
    return (
        f"no closure was accepted: of {filtered.pairs_total} pairs the filter kept {filtered.pairs_kept}, scan context"
        f" compared {sum(m.pairs_compared for m in matched)} and proposed {len(closures)}, registration accepted"
        f" {registered}, of which the radio check left {checked}{often}",
    )
