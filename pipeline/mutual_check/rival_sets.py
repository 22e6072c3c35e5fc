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
from wiclosure.pipeline.mutual_check.odds import Verdict, in_words
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.set_evidence import SetEvidence
from wiclosure.types import Closure, IntArray, Stage, Trajectory, WirelessLog

_FEWEST = 3  # closures of a set that may contradict another


@dataclass(frozen=True, eq=False)
class RivalSets:
    """Sets of closures of two robots that contradict each other, and what the radio tells of them.

    Args:
        pair: the robots.
        kept: rows of the closures of the set that the radio speaks for.
        lost: rows of the closures of the sets that it speaks against; none where it does not decide.
        log_odds: natural logarithm of the odds for the set that is kept.
        cause: what is wrong with the log if that set is true; empty for nothing.
    """

    pair: tuple[str, str]
    kept: frozenset[int]
    lost: frozenset[int]
    log_odds: float
    cause: str = ""

    @property
    def decides(self) -> bool:
        """Whether the odds are decisive."""
        return bool(self.lost)

    @property
    def sentence(self) -> str:
        """For the user."""
        name = f"{self.pair[0]} and {self.pair[1]}"
        if self.decides:
            return (
                f"{name}: {len(self.kept)} closures that agree with each other contradict {len(self.lost)} others that"
                " agree as well, as where places look alike; what the robots measured of each other speaks for the"
                f" {len(self.kept)} ({in_words(self.log_odds)}, whatever known error the log has); the others are left"
                " out"
            )
        story = f"if this holds: {self.cause}" if self.cause else "if nothing is wrong with the log"
        return (
            f"{name}: which of the sets of closures that contradict each other is true, what the robots measured of"
            f" each other does not decide: most likely the {len(self.kept)} ({in_words(self.log_odds)}), {story}"
        )


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
    for rows_of_sets in checked.sets_in_doubt(_FEWEST):
        sets = [[checked.closures[row] for row in rows.tolist()] for rows in rows_of_sets]
        pair = (sets[0][0].query.robot, sets[0][0].match.robot)
        both = {robot: trajectories[robot] for robot in pair}
        radio = PairRadio.of(pair, both, wireless, config.filter.alignment)
        if radio.measurements:
            others = _considered(checked, pair)
            weighed = [_weighed(of, others - len(of), radio, config.mutual_check) for of in sets]
            found.append(_told(pair, rows_of_sets, weighed, config.mutual_check))
    return found


def without_lost(closures: Sequence[Closure], rivals: Sequence[RivalSets]) -> tuple[Closure, ...]:
    """The closures that were given to the consistency check, those of sets that the radio speaks against rejected."""
    sentence = {row: one.sentence for one in rivals for row in one.lost}
    return tuple(
        closure.rejected(Stage.RADIO_CHECK, sentence[row]) if row in sentence else closure
        for row, closure in enumerate(closures)
    )


@dataclass(frozen=True, slots=True)
class _Score:
    """How likely a set is beside others, as a natural logarithm; its likeliest cause; whether it beats the radio."""

    log_likelihood: float
    cause: str
    convinces: bool


def _told(
    pair: tuple[str, str], rows_of_sets: Sequence[IntArray], weighed: Sequence[_Score], settings: MutualCheckSettings
) -> RivalSets:
    scores = np.array([score.log_likelihood for score in weighed])
    best = int(scores.argmax())
    others = np.delete(np.arange(len(scores)), best)
    kept = frozenset(rows_of_sets[best].tolist())
    decides = (scores[others] < scores[best] - np.log(settings.decisive_odds)).all() and weighed[best].convinces
    gone = frozenset(row for n in others.tolist() for row in rows_of_sets[n].tolist()) if decides else frozenset()
    return RivalSets(pair, kept, gone - kept, float(scores[best] - logsumexp(scores[others])), weighed[best].cause)


def _considered(checked: PcmResult, pair: tuple[str, str]) -> int:
    return next(one.considered for one in checked.pairs if {one.robot_a, one.robot_b} == set(pair))


def _weighed(closures: Sequence[Closure], others: int, radio: PairRadio, settings: MutualCheckSettings) -> _Score:
    evidence = SetEvidence.of(closures, others, radio)
    errors = evidence.errors()
    right = evidence.if_right(errors, settings)
    alone = evidence.weighed(errors, settings)
    convinces = alone.verdict in {Verdict.CLOSURES, Verdict.COMPATIBLE}
    return _Score(float(logsumexp(list(right.values()))), max(right, key=lambda cause: right[cause]), convinces)
