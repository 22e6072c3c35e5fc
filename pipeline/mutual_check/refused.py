"""Closures that the radio check left, against those that it refused.

What one log leaves of many closures agrees with it, and so with itself, however wrong it is.  So where it refuses most,
sets that agree among the refused ones are rivals of what is left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.odds import Verdict, Weighed
from wiclosure.pipeline.mutual_check.pair_check import PairCheck, PairOutcome, agreeing, ends
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.rivals.sets import FEWEST, RivalSets, told_apart
from wiclosure.types import Closure, PredictionKind, Stage, Trajectory, survivors


def weigh_refused(outcome: PairOutcome, radio: PairRadio, config: Config) -> PairCheck | None:
    """Of two robots, where the log does not decide for what it left; None where it does, or left all or nothing.

    Args:
        outcome: of two robots that heard each other.
        radio: what they measured of each other.
        config: of the run.
    """
    live, registered = outcome.live, survivors(outcome.registered, Stage.REGISTRATION)
    left = _sets(live, radio.trajectories, config)
    refused = [c for c in registered if (c.query, c.match) not in ends(live)]
    others = _sets(refused, radio.trajectories, config) if len(refused) > len(live) else []
    if len(left) == 1 and others:
        told = _told([*left, *others], outcome, radio, config)
        if told.decides and ends([outcome.registered[row] for row in told.kept]) == ends(left[0]):
            return PairCheck(outcome.pair, contested=told.sentence) if told.contested else None
        return _check(told, max(map(len, others)))
    if len(left) > 1 and outcome.kept.predicts is PredictionKind.HEADING:
        # A compass that is wrong leaves only what is false, and then the log speaks against all of it.
        told = _told(left, outcome, radio, config)
        return _check(told, len(left[0])) if told.contradicted and not told.decides else None
    return None


def _told(sets: Sequence[Sequence[Closure]], outcome: PairOutcome, radio: PairRadio, config: Config) -> RivalSets:
    """Which of several sets the log speaks for."""
    row_of = {(c.query, c.match): row for row, c in enumerate(outcome.registered)}
    rows = [np.array([row_of[c.query, c.match] for c in each]) for each in sets]
    return told_apart(rows, outcome.registered, range(len(row_of)), radio, config.mutual_check)


def _check(told: RivalSets, largest: int) -> PairCheck:
    decided = Verdict.CLOSURES if told.cause else Verdict.COMPATIBLE
    weighed = Weighed(decided if told.decides else Verdict.UNDECIDED, told.log_odds, told.cause)
    return PairCheck(told.pair, weighed, found=agreeing(len(told.kept) if told.decides else largest))


def _sets(closures: Sequence[Closure], both: Mapping[str, Trajectory], config: Config) -> list[list[Closure]]:
    """Sets of closures that agree with each other; several where nothing tells which of them is true."""
    checked = pairwise_consistent(closures, both, judged_by(config))
    if in_doubt := checked.sets_in_doubt(FEWEST):
        return [[checked.closures[row] for row in rows.tolist()] for rows in in_doubt[0]]
    accepted = survivors(checked.closures, Stage.CONSISTENCY)
    return [accepted] if len(accepted) > 1 else []


def judged_by(config: Config) -> PcmSettings:
    """What a published threshold calls consistent would make evidence of what agrees by chance."""
    return PcmSettings(noise=config.pcm.noise) if config.pcm.published else config.pcm
