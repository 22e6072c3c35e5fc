"""Sets of closures that contradict each other, of which the radio tells the true one, whatever is wrong with its log.

Where places look alike, false closures agree with each other as true ones do, and how many there are of each tells
little.  A log with a systematic error predicts nothing, but it still fits one set better than another: each is weighed
by what the robots measured of each other, over all errors that the log may have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from wiclosure.backends.consistency.pcm import PcmResult
from wiclosure.pipeline.config import Config, MutualCheckSettings
from wiclosure.pipeline.mutual_check.odds import TELLING, Verdict, in_words
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.set_evidence import SetEvidence
from wiclosure.types import Closure, IntArray, Stage, Trajectory, WirelessLog, survivors

MAY_BE_WRONG = "the map may be wrong"
FEWEST = 3  # closures of a set that may contradict another


@dataclass(frozen=True, eq=False)
class RivalSets:
    """Sets of closures of two robots that contradict each other, and what the radio tells of them.

    Args:
        pair: the robots.
        kept: rows of the closures of the set that the radio speaks for.
        lost: rows of the closures of the sets that it speaks against; none where it does not decide.
        log_odds: natural logarithm of the odds for the set that is kept.
        cause: what is wrong with the log if that set is true; empty for nothing.
        contradicted: true where the log, as it claims to be, speaks against every set.
        contested: what would have to be wrong with the log for another set to fit it better than this one does; then
            only how seldom that is speaks for this one. Empty where it fits this one best.
    """

    pair: tuple[str, str]
    kept: frozenset[int]
    lost: frozenset[int]
    log_odds: float
    cause: str = ""
    contradicted: bool = False
    contested: str = ""

    @property
    def decides(self) -> bool:
        """Whether the odds are decisive."""
        return bool(self.lost)

    @property
    def doubts(self) -> bool:
        """Whether a map that rests on the set that is kept may be wrong."""
        return bool(self.contested)

    @property
    def sentence(self) -> str:
        """For the user."""
        name = f"{self.pair[0]} and {self.pair[1]}"
        if self.decides:
            return (
                f"{name}: {len(self.kept)} closures that agree with each other contradict {len(self.lost)} others that"
                " agree as well, as where places look alike; what the robots measured of each other speaks for the"
                f" {len(self.kept)} ({in_words(self.log_odds)}, whatever known error the log has); the others are left"
                f" out{self._yet}"
            )
        story = f"if this holds: {self.cause}" if self.cause else "if nothing is wrong with the log"
        return (
            f"{name}: which of the sets of closures that contradict each other is true, what the robots measured of"
            f" each other does not decide: most likely the {len(self.kept)} ({in_words(self.log_odds)}), {story}"
        )

    @property
    def _yet(self) -> str:
        if not self.contested:
            return ""
        return f"; yet {MAY_BE_WRONG}, since the log would fit others better if this held: {self.contested}"


def weigh_rivals(
    checked: PcmResult, trajectories: Mapping[str, Trajectory], wireless: WirelessLog, config: Config
) -> list[RivalSets]:
    """Of each two robots whose closures the consistency check leaves in doubt, the set that the radio speaks for.

    Args:
        checked: closures, and the sets that were found among them.
        trajectories: keyframe odometry of all robots.
        wireless: the whole log, as it was read.
        config: of the run.
    """
    found: list[RivalSets] = []
    for rows_of_sets in checked.sets_in_doubt(FEWEST):
        first = checked.closures[int(rows_of_sets[0][0])]
        pair = (first.query.robot, first.match.robot)
        both = {robot: trajectories[robot] for robot in pair}
        radio = PairRadio.of(pair, both, wireless, config.filter.alignment)
        if radio.measurements:
            own = [row for row, c in enumerate(checked.closures) if (c.query.robot, c.match.robot) == pair]
            found.append(told_apart(rows_of_sets, checked.closures, own, radio, config.mutual_check))
    return found


def told_apart(
    rows_of_sets: Sequence[IntArray],
    closures: Sequence[Closure],
    own: Sequence[int],
    radio: PairRadio,
    settings: MutualCheckSettings,
) -> RivalSets:
    """Which of some sets of closures of two robots the radio speaks for.

    Args:
        rows_of_sets: rows of the closures of each set, two at least.
        closures: that the rows mean.
        own: rows of all closures of the two robots that registration tried.
        radio: what they measured of each other.
        settings: probabilities of errors, and when odds are decisive.
    """
    tried = [c for c in (closures[row] for row in own) if c.rejected_at is not Stage.MATCHING]
    considered = len(survivors(tried, Stage.REGISTRATION))
    weighed = [
        _weighed([closures[row] for row in rows.tolist()], considered - len(rows), tried, radio, settings)
        for rows in rows_of_sets
    ]
    scores = np.array([score.log_likelihood for score in weighed])
    best = int(scores.argmax())
    others = np.delete(np.arange(len(scores)), best)
    kept = frozenset(rows_of_sets[best].tolist())
    decides = (scores[others] < scores[best] - np.log(settings.decisive_odds)).all() and weighed[best].convinces
    gone = frozenset(row for n in others.tolist() for row in rows_of_sets[n].tolist()) if decides else frozenset()
    log_odds = float(scores[best] - logsumexp(scores[others]))
    contradicted = all(score.contradicted for score in weighed)
    fitting = max(weighed, key=lambda score: score.fits)
    contested = fitting.cause_of_fit if fitting is not weighed[best] and decides else ""
    return RivalSets(radio.pair, kept, gone - kept, log_odds, weighed[best].cause, contradicted, contested)


def without_lost(closures: Sequence[Closure], rivals: Sequence[RivalSets]) -> tuple[Closure, ...]:
    """The closures that were given to the consistency check, those of sets that the radio speaks against rejected."""
    sentence = {row: one.sentence for one in rivals for row in one.lost}
    return tuple(
        closure.rejected(Stage.RADIO_CHECK, sentence[row]) if row in sentence else closure
        for row, closure in enumerate(closures)
    )


@dataclass(frozen=True, slots=True)
class _Score:
    """Of one set.

    Args:
        log_likelihood: beside the others.
        cause: what is likeliest wrong with the log.
        convinces: whether the log speaks for it.
        contradicted: whether the log, as it claims to be, speaks against it.
        fits: how well the log fits it at best, with a known error undone or without one; however seldom that is.
        cause_of_fit: that error.
    """

    log_likelihood: float
    cause: str
    convinces: bool
    contradicted: bool
    fits: float
    cause_of_fit: str


def _weighed(
    closures: Sequence[Closure],
    others: int,
    tried: Sequence[Closure],
    radio: PairRadio,
    settings: MutualCheckSettings,
) -> _Score:
    evidence = SetEvidence.of(closures, others, radio, tried)
    errors, partial = evidence.errors(), evidence.partial_errors()
    right = evidence.if_right(errors, settings, partial)
    alone = evidence.weighed(errors, settings, two_errors=partial)
    # A log that says next to nothing where a set has the robots speaks for no set, however it speaks against others.
    best = max([evidence.claimed, *errors, *partial], key=lambda one: one.implied)
    convinces = best.implied > TELLING and alone.verdict in {Verdict.CLOSURES, Verdict.COMPATIBLE}
    cause = max(right, key=lambda cause: right[cause])
    return _Score(
        float(logsumexp(list(right.values()))), cause, convinces, evidence.claimed.contradicts, best.implied, best.fault
    )
