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
from wiclosure.pipeline.mutual_check.check import places
from wiclosure.pipeline.mutual_check.odds import Agreement, Verdict, Weighed, if_closures_are_right, in_words, weigh
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio, central
from wiclosure.types import Closure, Stage, Trajectory, WirelessLog

_FEWEST = 3  # closures of a set that may contradict another


@dataclass(frozen=True, eq=False)
class RivalSets:
    """Sets of closures of two robots that contradict each other, and what the radio tells of them.

    Args:
        pair: the robots.
        kept: rows of the closures of the set that the radio speaks for.
        lost: rows of the closures that are in a set that the radio speaks against.
        log_odds: natural logarithm of the odds for the set that is kept.
    """

    pair: tuple[str, str]
    kept: frozenset[int]
    lost: frozenset[int]
    log_odds: float

    @property
    def sentence(self) -> str:
        """For the user."""
        return (
            f"{self.pair[0]} and {self.pair[1]}: {len(self.kept)} closures that agree with each other contradict"
            f" {len(self.lost)} others that agree as well, as where places look alike; what the robots measured of each"
            f" other speaks for the {len(self.kept)} ({in_words(self.log_odds)}, whatever known error the log has);"
            " the others are left out"
        )


def weigh_rivals(
    checked: PcmResult, trajectories: Mapping[str, Trajectory], wireless: WirelessLog, config: Config
) -> list[RivalSets]:
    """Of each two robots whose closures the consistency check leaves in doubt, the sets that the radio speaks against.

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
        if radio.measurements == 0:
            continue
        others = _considered(checked, pair)
        weighed = [_weighed(of, others - len(of), radio, config.mutual_check) for of in sets]
        scores = np.array([score for score, _ in weighed])
        best = int(scores.argmax())
        lost = np.flatnonzero(scores < scores[best] - np.log(config.mutual_check.decisive_odds))
        if len(lost) == len(sets) - 1 and weighed[best][1].verdict in {Verdict.CLOSURES, Verdict.COMPATIBLE}:
            kept = frozenset(rows_of_sets[best].tolist())
            gone = frozenset(row for n in lost.tolist() for row in rows_of_sets[n].tolist())
            found.append(RivalSets(pair, kept, gone - kept, float(scores[best] - logsumexp(scores[lost]))))
    return found


def without_lost(closures: Sequence[Closure], rivals: Sequence[RivalSets]) -> tuple[Closure, ...]:
    """The closures that were given to the consistency check, those of sets that the radio speaks against rejected."""
    sentence = {row: one.sentence for one in rivals for row in one.lost}
    return tuple(
        closure.rejected(Stage.RADIO_CHECK, sentence[row]) if row in sentence else closure
        for row, closure in enumerate(closures)
    )


def _considered(checked: PcmResult, pair: tuple[str, str]) -> int:
    return next(one.considered for one in checked.pairs if {one.robot_a, one.robot_b} == set(pair))


def _weighed(
    closures: Sequence[Closure], others: int, radio: PairRadio, settings: MutualCheckSettings
) -> tuple[float, Weighed]:
    """How likely a set is beside others, as a natural logarithm, and the verdict were it the only one."""
    middle = [central(closures, radio.trajectories)]
    claimed, errors = radio.claimed(middle), radio.errors(middle)
    agreement = Agreement(len(closures), others, places(closures))
    right = if_closures_are_right(claimed, errors, settings)
    # The others are false in every one of these stories; what differs is that this one is not.
    score = float(logsumexp(list(right.values()))) - agreement.log_look_alike
    return score, weigh(claimed, errors, agreement, Agreement(0, 0, 0.0), 0.0, settings)
