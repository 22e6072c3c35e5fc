"""What is weighed of a set of closures: how likely it is false, and the log where it has the robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import rel_entr

from wiclosure import se3
from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.odds import (
    FAILS_IF_RIGHT,
    MOST_PLACES,
    Agreement,
    Verdict,
    Weighed,
    if_closures_are_right,
    weigh,
)
from wiclosure.pipeline.mutual_check.radio_evidence import Explained, PairRadio, central
from wiclosure.types import Closure, measured_poses

PLACE_KEYFRAMES = 10  # apart along a path: what is seen there is something else
NEAR_M = 5.0  # keyframes that are so near register, if they are truly there
_NOTHING = Agreement(0, 0, 0.0)


@dataclass(frozen=True, eq=False)
class SetEvidence:
    """Closures that agree with each other, and what the log of their robots tells of them.

    Args:
        closures: how many, how many others contradict them, and of how many places.
        claimed: the log as it claims to be, where the set has the robots.
        middle: the closure that stands for the set.
        radio: the log.
        log_missed: log-probability of so few registrations, were the set right, of keyframes that it has near.
    """

    closures: Agreement
    claimed: Explained
    middle: Closure
    radio: PairRadio
    log_missed: float = 0.0

    @classmethod
    def of(
        cls, agreeing: Sequence[Closure], others: int, radio: PairRadio, tried: Sequence[Closure] = ()
    ) -> SetEvidence:
        """Of a set that `others` registered closures contradict, of all that registration `tried`."""
        middle = central(agreeing, radio.trajectories)
        closures = Agreement(len(agreeing), others, places(agreeing))
        return cls(closures, radio.claimed([middle]), middle, radio, _log_missed(agreeing, middle, radio, tried))

    def errors(self, *, search: bool = True) -> list[Explained]:
        """The log with each known error undone; `search`: also where it tells an alignment of its own."""
        return self.radio.errors([self.middle], search=search)

    def partial_errors(self) -> list[Explained]:
        """The log with an error of a part of it undone, the likeliest ones; each is as seldom as two errors."""
        return self.radio.partial_errors([self.middle])

    def weighed(
        self,
        errors: Sequence[Explained],
        settings: MutualCheckSettings,
        predicted: Agreement = _NOTHING,
        refuted_places: float = 0.0,
        two_errors: Sequence[Explained] = (),
    ) -> Weighed:
        """The set against the radio; see `odds.weigh`."""
        return weigh(self.claimed, errors, self.closures, predicted, refuted_places, settings, two_errors)

    def weighed_twice(
        self,
        errors: Sequence[Explained],
        settings: MutualCheckSettings,
        predicted: Agreement = _NOTHING,
        refuted_places: float = 0.0,
    ) -> Weighed:
        """The same; before the set is refused, two errors at once are tried.

        With one of two errors undone a log still predicts falsely, and may well speak against closures that are true.
        """
        told = self.weighed(errors, settings, predicted, refuted_places)
        if told.verdict not in {Verdict.NEITHER, Verdict.RADIO}:
            return told
        two_errors = self.radio.second_errors([self.middle], errors)
        return self.weighed(errors, settings, predicted, refuted_places, two_errors)

    def if_right(
        self, errors: Sequence[Explained], settings: MutualCheckSettings, two_errors: Sequence[Explained] = ()
    ) -> Mapping[str, float]:
        """Log-evidence of log and registrations where the set is right, by what is wrong with the log."""
        right = if_closures_are_right(self.claimed, errors, settings, two_errors)
        # The others are false in every one of these stories; what differs is that this one is not.
        each = self.log_missed - self.closures.log_look_alike
        return {cause: value + each for cause, value in right.items()}


def places(closures: Sequence[Closure]) -> float:
    """How many separate places closures come from, by how far they reach along the path on which that is less."""
    if not closures:
        return 0.0
    ends = np.array([(c.query.index, c.match.index) for c in closures])
    return 1.0 + float(np.ptp(ends, axis=0).min()) / PLACE_KEYFRAMES


def _log_missed(agreeing: Sequence[Closure], middle: Closure, radio: PairRadio, tried: Sequence[Closure]) -> float:
    """By how often keyframes that are near each other fail to register (Chernoff's bound of the binomial tail)."""
    if not tried:
        return 0.0
    a, b = (radio.trajectories[robot] for robot in radio.pair)
    T_a_b = a.poses[middle.query.index] @ measured_poses([middle])[0][0] @ se3.inverse(b.poses[middle.match.index])
    index_a, index_b = np.array([(c.query.index, c.match.index) for c in tried]).T
    apart_m = np.linalg.norm(a.positions[index_a] - se3.transform(T_a_b, b.positions[index_b]), axis=1)
    near = [tried[row] for row in np.flatnonzero(apart_m < NEAR_M).tolist()]
    if not near:
        return 0.0
    found = {(c.query, c.match) for c in agreeing}
    missed = sum((c.query, c.match) not in found for c in near) / len(near)
    if missed <= FAILS_IF_RIGHT:
        return 0.0
    divergence = rel_entr(missed, FAILS_IF_RIGHT) + rel_entr(1.0 - missed, 1.0 - FAILS_IF_RIGHT)
    return -min(places(near), MOST_PLACES) * float(divergence)
