"""Two robots before radio and closures are weighed against each other, and what came of it, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from wiclosure.pipeline.mutual_check.map_check import Contradiction
from wiclosure.pipeline.mutual_check.odds import Verdict, Weighed, in_words
from wiclosure.pipeline.mutual_check.rivals.sets import MAY_BE_WRONG
from wiclosure.types import CandidatePairs, Closure, KeyframeId

Pair = tuple[str, str]


@dataclass(frozen=True, eq=False)
class PairOutcome:
    """What filter, matching, registration and radio check made of two robots.

    Args:
        pair: the robots.
        inliers: pairs that the filter kept, with its predictions.
        registered: closures as registration left them.
        checked: the same as the radio check left them.
    """

    pair: Pair
    kept: CandidatePairs
    registered: tuple[Closure, ...]
    checked: tuple[Closure, ...]

    @property
    def live(self) -> list[Closure]:
        """Closures that agree with all that is known of the frames so far."""
        return [closure for closure in self.checked if closure.live]


@dataclass(frozen=True, eq=False)
class PairCheck:
    """What came of two robots that radio and closures tell differently of.

    Args:
        pair: the robots.
        weighed: the verdict; None where no set of closures contradicts the radio.
        blind: closures that were registered without prediction.
        lost: closures of the first round that are rejected.
        found: the set of closures, and how it contradicts the radio, as a clause.
        contested: what is said where the radio is right unless a known error is at fault, or does not decide between
            sets of closures; empty otherwise.
        alone: whether the robots go on without radio, though nothing was weighed.
    """

    pair: Pair
    weighed: Weighed | None = None
    blind: tuple[Closure, ...] = ()
    lost: frozenset[tuple[KeyframeId, KeyframeId]] = frozenset()
    found: str = ""
    contested: str = ""
    alone: bool = False

    @property
    def sentence(self) -> str:
        """For the user; empty where there is nothing to say."""
        return self.said()

    def said(self, by_map: Contradiction | None = None) -> str:
        """The same, with the cause that a merged map tells, where there is one: it knows more than one set did."""
        return self.contested if self.weighed is None else _sentence(self.pair, self.weighed, self.found, by_map)

    @property
    def drops_radio(self) -> bool:
        """Whether these robots go on without radio: also where nothing decides, so that it does no harm."""
        without = {Verdict.CLOSURES, Verdict.COMPATIBLE, Verdict.UNDECIDED}
        return self.alone or (self.weighed is not None and self.weighed.verdict in without)

    @property
    def undecided(self) -> bool:
        """Whether nothing decided."""
        return self.weighed is not None and self.weighed.verdict is Verdict.UNDECIDED

    @property
    def doubts(self) -> bool:
        """Whether a map that joins these robots may be wrong."""
        return self.undecided or bool(self.contested)


def ends(closures: Sequence[Closure]) -> frozenset[tuple[KeyframeId, KeyframeId]]:
    """Keyframes of each."""
    return frozenset((c.query, c.match) for c in closures)


def agreeing(closures: int) -> str:
    """A set of so many, as a clause."""
    return f"{closures} closures that agree with each other"


def _sentence(pair: Pair, weighed: Weighed, found: str, by_map: Contradiction | None) -> str:
    odds = in_words(weighed.log_odds)
    fault = f"most likely: {weighed.cause}" if weighed.cause else "for no known reason"
    if by_map is not None and by_map.causes:
        odds = odds if weighed.verdict is Verdict.UNDECIDED else by_map.odds
        fault = f"by where the merged map has the robots: {by_map.likely}"
    said = {
        Verdict.CLOSURES: f"the radio is the likely fault ({odds}), {fault}; it contradicts {found}; its measurements"
        " between these robots are left out",
        Verdict.COMPATIBLE: f"the radio's alignment is the likely fault ({odds}): it contradicts {found}, and its"
        " measurements allow those as well; it was less certain than it seemed, and is left out between these robots",
        Verdict.RADIO: f"places that look alike are the likely fault ({odds}): {found} contradict the radio, which"
        " nothing else speaks against; the closures are left out",
        Verdict.NEITHER: f"the radio is the likely fault ({odds}), {fault}; with that put right it still contradicts"
        f" {found}, from places that look alike, it seems; no closure between these robots is accepted",
        Verdict.UNDECIDED: f"{MAY_BE_WRONG}, nothing decides ({odds}): {found} contradict the radio; the radio"
        f" may be at fault, {fault}, or the places look alike; its measurements between"
        " these robots are left out",
    }
    verdict = weighed.verdict
    if verdict is Verdict.COMPATIBLE and by_map is not None and by_map.causes:
        verdict = Verdict.CLOSURES
    return f"{pair[0]} and {pair[1]}: {said[verdict]}"
