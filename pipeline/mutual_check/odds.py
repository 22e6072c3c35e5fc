"""Radio against closures: which of the two is wrong, by the odds.

Three kinds of stories are weighed, each with all that it has to explain:

- *the radio is right*, and the closures that contradict it come from places that look alike;
- *the closures are right*, and the log as it claims to be is compatible with them after all, or has one of the known
  systematic errors, or two of them, or an unknown one, which leaves noise or happens to fit another alignment;
- *neither*: the log has a known error, and with that undone tells an alignment that contradicts the closures, too.

An alignment that the closures imply costs the log nothing; one that the log chooses for itself is one of many as exact
(MacKay, "Information Theory, Inference, and Learning Algorithms", ch. 28: the Occam factor).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.special import logsumexp

from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.radio_evidence import Explained

MOST_PLACES = 3  # that count as separate: regular surroundings repeat themselves
FAILS_IF_RIGHT = 0.3  # registrations near the predicted pose of keyframes that are truly so near
TELLING = float(np.log(100.0))  # evidence beyond that of a log that says nothing


@dataclass(frozen=True, slots=True)
class Agreement:
    """Closures that agree with each other, or with the radio.

    Args:
        agreeing: how many.
        others: registered closures of the same robots that contradict them.
        places: separate places along the paths that they come from.
    """

    agreeing: int
    others: int
    places: float

    @property
    def log_look_alike(self) -> float:
        """Log-probability that all of them are false.

        Each separate place has to look like another; how often that happens in these surroundings, the share of
        registered closures says that contradict the rest (with half a closure to either side, Jeffreys' prior).
        """
        share = (self.others + 0.5) / (self.agreeing + self.others + 1.0)
        return min(self.places, MOST_PLACES) * float(np.log(share)) if self.agreeing else 0.0


def in_words(log_odds: float) -> str:
    """Odds, as a natural logarithm, for the user."""
    if log_odds < np.log(1000.0):
        return f"{np.exp(log_odds):.0f} to 1"
    return f"10^{log_odds / np.log(10):.0f} to 1"


class Verdict(StrEnum):
    """Who is right."""

    COMPATIBLE = "compatible"
    RADIO = "radio"
    CLOSURES = "closures"
    NEITHER = "neither"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True)
class Weighed:
    """A verdict, its odds against all else as a natural logarithm, and the likeliest error of the radio if any."""

    verdict: Verdict
    log_odds: float
    cause: str


def agrees_with_radio(claimed: Explained) -> bool:
    """Whether the log, as it claims to be, speaks for the alignment of closures, and for no other."""
    return claimed.implied > TELLING and not claimed.contradicts


def weigh(
    claimed: Explained,
    errors: Sequence[Explained],
    closures: Agreement,
    predicted: Agreement,
    refuted_places: float,
    settings: MutualCheckSettings,
    two_errors: Sequence[Explained] = (),
) -> Weighed:
    """Weighs the stories.

    Args:
        claimed: the log as it claims to be.
        errors: the log with each known systematic error undone.
        closures: those that agree with each other and contradict the radio.
        predicted: those that agree with the radio.
        refuted_places: separate places where the radio predicts two keyframes close together, of which registration
            found none to be.
        settings: probabilities of errors, and when odds are decisive.
        two_errors: the log with two of those errors undone, where the closures have the robots.
    """
    known, unknown = settings.systematic_error, settings.unknown_error
    as_claimed, each = np.log(1.0 - known - unknown), np.log(known / max(len(errors), 1))
    other_look_alike = predicted.log_look_alike
    radio = (
        as_claimed
        + claimed.log_evidence
        + closures.log_look_alike
        + min(refuted_places, MOST_PLACES) * np.log(FAILS_IF_RIGHT)
    )
    right = {
        cause: value + other_look_alike
        for cause, value in if_closures_are_right(claimed, errors, settings, two_errors).items()
    }
    neither = {
        e.fault: each + e.log_evidence + closures.log_look_alike + other_look_alike for e in errors if e.contradicts
    }
    sums = {
        Verdict.RADIO: radio,
        Verdict.CLOSURES: float(logsumexp(list(right.values()))),
        Verdict.NEITHER: float(logsumexp(list(neither.values()))) if neither else -np.inf,
    }
    likeliest = max(sums, key=lambda verdict: sums[verdict])
    log_odds = float(sums[likeliest] - logsumexp([value for verdict, value in sums.items() if verdict != likeliest]))
    if log_odds < np.log(settings.decisive_odds):
        return Weighed(Verdict.UNDECIDED, log_odds, _likeliest({**neither, **right, "": -np.inf}))
    if likeliest is Verdict.CLOSURES and not _likeliest(right):
        return Weighed(Verdict.COMPATIBLE, log_odds, "")
    wrong = {Verdict.CLOSURES: right, Verdict.NEITHER: neither}.get(likeliest)
    return Weighed(likeliest, log_odds, "" if wrong is None else _likeliest(wrong))


def if_closures_are_right(
    claimed: Explained,
    errors: Sequence[Explained],
    settings: MutualCheckSettings,
    two_errors: Sequence[Explained] = (),
) -> dict[str, float]:
    """Log-evidence of the log where closures have the robots, by what is wrong with it; by "" if nothing is."""
    known, unknown = settings.systematic_error, settings.unknown_error
    each = np.log(known / max(len(errors), 1))
    return {
        "": float(np.log(1.0 - known - unknown)) + claimed.implied,
        **{e.fault: float(each) + e.implied for e in errors},
        **{e.fault: 2 * float(each) + e.implied for e in two_errors},
        "an error of the radio that is none of the known ones": float(np.log(unknown)) + max(claimed.log_evidence, 0.0),
    }


def _likeliest(causes: Mapping[str, float]) -> str:
    return max(causes, key=lambda cause: causes[cause])
