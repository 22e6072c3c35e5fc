"""Filter, matching, registration and radio check, again with less of the log where closures refute the radio."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

from wiclosure.frontends.config import MatchingSettings
from wiclosure.frontends.front_end import FrontEndResult, describe_shifted
from wiclosure.frontends.place_recognition.intra_robot_loops import intra_robot_loops
from wiclosure.frontends.place_recognition.matching import MatchResult, match
from wiclosure.interfaces import CandidateFilter
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.check import check_pair
from wiclosure.pipeline.mutual_check.pair_check import PairCheck, PairOutcome
from wiclosure.pipeline.mutual_check.radio_check import radio_checked
from wiclosure.pipeline.mutual_check.second_round import every_pair, unpredicted
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.runtime.stopwatch import Stopwatch
from wiclosure.pipeline.stages.registrations import RegistrationPool
from wiclosure.pipeline.stages.viewer import Viewer
from wiclosure.types import CandidatePairs, Closure, FilterResult, Stage, Trajectory, WirelessLog


@dataclass(frozen=True, eq=False)
class Attempt:
    """What filter, matching, registration and radio check made of one log."""

    filtered: FilterResult
    matched: tuple[MatchResult, ...]
    registered: tuple[Closure, ...]
    closures: tuple[Closure, ...]

    def of(self, kept: CandidatePairs) -> PairOutcome:
        """The part of two robots."""
        pair = (kept.robot_a, kept.robot_b)
        own = [n for n, c in enumerate(self.registered) if (c.query.robot, c.match.robot) == pair]
        return PairOutcome(pair, kept, tuple(self.registered[n] for n in own), tuple(self.closures[n] for n in own))


@dataclass(frozen=True, eq=False)
class Attempts:
    """Attempts with ever less of the log, until radio and closures no longer contradict each other."""

    fronts: Mapping[str, FrontEndResult]
    keyframes: Mapping[str, Trajectory]
    candidate_filter: CandidateFilter
    config: Config
    registrations: RegistrationPool
    progress: Progress
    viewer: Viewer
    took: Stopwatch = field(default_factory=Stopwatch)
    registration_s: list[float] = field(default_factory=list)
    filter_s: list[float] = field(default_factory=list)
    blind_s: list[float] = field(default_factory=list)

    def settled(self, wireless: WirelessLog, known: Sequence[PairCheck] = ()) -> tuple[Attempt, list[PairCheck]]:
        """The last attempt, and what was found of pairs of robots on the way.

        Args:
            wireless: the log.
            known: pairs of robots that go on without radio from the start.
        """
        checks = {one.pair: one for one in known}
        wireless = _without(wireless, checks)
        attempt = self._attempt(wireless)
        while self.config.mutual_check.enabled:
            heard = {(one.robot_a, one.robot_b) for one in attempt.filtered.alignments} - set(checks)
            with self.took.time("check"):
                found = [
                    self._checked(attempt.of(p), wireless)
                    for p in attempt.filtered.pairs
                    if (p.robot_a, p.robot_b) in heard
                ]
            checks |= {one.pair: one for one in found}
            dropped = [one.pair for one in found if one.drops_radio]
            if not dropped:
                break
            wireless = _without(wireless, dropped)
            attempt = self._attempt(wireless)
        closures = attempt.closures
        for one in checks.values():
            closures = _as_checked(closures, one)
        filtered = replace(attempt.filtered, diagnosis=_without_dropped(attempt.filtered.diagnosis, checks.values()))
        return replace(attempt, filtered=filtered, closures=closures), list(checks.values())

    def unpruned(self, attempt: Attempt, refuted: Collection[tuple[str, str]]) -> Attempt:
        """With closures of all pairs of keyframes of some robots, of which a log that was refuted had pruned some.

        Args:
            attempt: as the log had it; returned as it is where nothing was pruned.
            refuted: the robots.
        """
        kept = {(p.robot_a, p.robot_b): len(p) for p in attempt.filtered.pairs}
        sizes = {pair: [len(self.keyframes[robot]) for robot in pair] for pair in refuted}
        whole = [
            every_pair(pair, size_a, size_b)
            for pair, (size_a, size_b) in sizes.items()
            if kept.get(pair, size_a * size_b) < size_a * size_b
        ]
        if not whole:
            return attempt
        with self.took.time("matching"):
            matched = _match(whole, self.fronts, self.config)
        live = {(c.query, c.match) for c in attempt.closures if c.live}
        proposed = [c for result in matched for c in result.closures if (c.query, c.match) not in live]
        with self.took.time("verification"):
            registered = self._registered(proposed)
        again = {(c.query, c.match) for c in registered}
        closures = [c for c in attempt.closures if (c.query, c.match) not in again]
        return replace(
            attempt,
            matched=(*attempt.matched, *matched),
            closures=(*closures, *(c.accepted(Stage.RADIO_CHECK) if c.live else c for c in registered)),
        )

    def _checked(self, outcome: PairOutcome, wireless: WirelessLog) -> PairCheck:
        return check_pair(outcome, self.keyframes, wireless, self.config, self._registered_blindly)

    def _registered_blindly(self, pair: tuple[str, str], also: Sequence[Closure]) -> list[Closure]:
        proposed = unpredicted(pair, also, self.fronts, self.config.matching, self.config.mutual_check.budget)
        began = perf_counter()
        with self.took.time("verification"):
            registered = self._registered(proposed)
        self.blind_s.append(perf_counter() - began)
        return registered

    def _attempt(self, wireless: WirelessLog) -> Attempt:
        filtered = self.candidate_filter.candidates(self.keyframes, wireless)
        self.filter_s.append(filtered.seconds)
        self.viewer.candidates(filtered)
        revisits = self.config.revisits
        with self.took.time("matching"):
            own = [intra_robot_loops(k, revisits) for k in self.keyframes.values()] if revisits.enabled else []
            matched = _match((*filtered.pairs, *own), self.fronts, self.config)
        proposed = [closure for result in matched for closure in result.closures]
        self.viewer.closures(proposed)
        with self.took.time("verification"):
            registered = self._registered(proposed)
        with self.took.time("check"):
            checked = radio_checked(registered, filtered.checks)
        self.viewer.closures(checked)
        return Attempt(filtered, matched, tuple(registered), tuple(checked))

    def _registered(self, proposed: Sequence[Closure]) -> list[Closure]:
        registered, uncached_s = self.registrations.register(proposed, self.progress)
        self.registration_s.append(uncached_s)
        return registered

    @property
    def seconds(self) -> dict[str, float]:
        """Per stage, as if nothing had been computed before."""
        return {
            "filter": sum(self.filter_s) + self.took["check"] - sum(self.blind_s),
            "matching": self.took["matching"],
            "verification": sum(self.registration_s),
        }


def _without_dropped(diagnosis: Sequence[str], checks: Iterable[PairCheck]) -> tuple[str, ...]:
    """Without what the filter says of robots whose measurements it was not given: why, the check says."""
    dropped = tuple(f"{a} and {b}: " for a, b in (one.pair for one in checks if one.drops_radio))
    return tuple(sentence for sentence in diagnosis if not sentence.startswith(dropped))


def _without(wireless: WirelessLog, pairs: Collection[tuple[str, str]]) -> WirelessLog:
    """A log without what these pairs of robots measured of each other."""
    dropped = {frozenset(pair) for pair in pairs}
    left = tuple(m for m in wireless.measurements if frozenset((m.receiver, m.transmitter)) not in dropped)
    return replace(wireless, measurements=left)


def _as_checked(closures: Sequence[Closure], check: PairCheck) -> tuple[Closure, ...]:
    """With the closures that were registered without prediction, and without those that lost."""
    if check.drops_radio:
        return tuple(closures)
    known = {(c.query, c.match) for c in closures if c.live}
    blind = [c for c in check.blind if c.live and (c.query, c.match) not in known]
    replaced = {(c.query, c.match) for c in blind}
    left = [c for c in closures if (c.query, c.match) not in replaced]
    if check.weighed is None:
        return (*left, *(c.accepted(Stage.RADIO_CHECK) for c in blind))
    lost = {*replaced, *check.lost}
    return tuple(
        c.rejected(Stage.RADIO_CHECK, check.sentence) if c.live and (c.query, c.match) in lost else c
        for c in (*left, *blind)
    )


def _match(
    candidates: Sequence[CandidatePairs], fronts: Mapping[str, FrontEndResult], config: Config
) -> tuple[MatchResult, ...]:
    """Proposes the candidates that look alike."""
    shifted = {
        robot: describe_shifted(front.clouds, config.scan_context, config.matching.lateral_shift_m)
        for robot, front in fronts.items()
    }
    return tuple(
        match(
            pairs,
            fronts[pairs.robot_a].descriptors,
            fronts[pairs.robot_b].descriptors,
            _settings_for(pairs, fronts, config),
            shifted[pairs.robot_a],
        )
        for pairs in candidates
    )


def _settings_for(pairs: CandidatePairs, fronts: Mapping[str, FrontEndResult], config: Config) -> MatchingSettings:
    """Loops within one robot have a budget of their own, by the length of its path."""
    if pairs.robot_a != pairs.robot_b:
        return config.matching
    own = max(1, round(len(fronts[pairs.robot_a].keyframes) / config.revisits.keyframes_per_loop))
    return config.matching.model_copy(update={"budget": min(own, config.matching.budget or own)})
