"""What is weighed of a set of closures: how likely it is false, and the log where it has the robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.odds import Agreement, Weighed, if_closures_are_right, weigh
from wiclosure.pipeline.mutual_check.radio_evidence import Explained, PairRadio, central
from wiclosure.types import Closure

_PLACE_KEYFRAMES = 10  # apart along a path: what is seen there is something else
_NOTHING = Agreement(0, 0, 0.0)


@dataclass(frozen=True, eq=False)
class SetEvidence:
    """Closures that agree with each other, and what the log of their robots tells of them.

    Args:
        closures: how many, how many others contradict them, and of how many places.
        claimed: the log as it claims to be, where the set has the robots.
        middle: the closure that stands for the set.
        radio: the log.
    """

    closures: Agreement
    claimed: Explained
    middle: Closure
    radio: PairRadio

    @classmethod
    def of(cls, agreeing: Sequence[Closure], others: int, radio: PairRadio) -> SetEvidence:
        """Of a set that `others` registered closures contradict."""
        middle = central(agreeing, radio.trajectories)
        return cls(Agreement(len(agreeing), others, places(agreeing)), radio.claimed([middle]), middle, radio)

    def errors(self, *, search: bool = True) -> list[Explained]:
        """The log with each known error undone; `search`: also where it tells an alignment of its own."""
        return self.radio.errors([self.middle], search=search)

    def weighed(
        self,
        errors: Sequence[Explained],
        settings: MutualCheckSettings,
        predicted: Agreement = _NOTHING,
        refuted_places: float = 0.0,
    ) -> Weighed:
        """The set against the radio; see `odds.weigh`."""
        return weigh(self.claimed, errors, self.closures, predicted, refuted_places, settings)

    def if_right(self, errors: Sequence[Explained], settings: MutualCheckSettings) -> Mapping[str, float]:
        """Log-evidence of the log and of the other sets being false, by what is wrong with the log."""
        right = if_closures_are_right(self.claimed, errors, settings)
        # The others are false in every one of these stories; what differs is that this one is not.
        return {cause: value - self.closures.log_look_alike for cause, value in right.items()}


def places(closures: Sequence[Closure]) -> float:
    """How many separate places closures come from, by how far they reach along the path on which that is less."""
    if not closures:
        return 0.0
    ends = np.array([(c.query.index, c.match.index) for c in closures])
    return 1.0 + float(np.ptp(ends, axis=0).min()) / _PLACE_KEYFRAMES
