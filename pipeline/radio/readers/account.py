"""What became of each row of a radio log: used, or left out for which reason."""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import dataclass, field

logger = logging.getLogger(__name__)


@dataclass(slots=True)
class Account:
    """Counts while a source is read; nothing is left out without a reason here.

    Args:
        where: the source, in messages.
        rows: how many were read.
        used: how many became measurements.
        left_out: how many did not, by reason, with the place and sentence of the first.
        ids: readings by id that names no robot.
        notes: what was decided while reading, as the unit of stamps.
        doubts: what may be a mistake of the settings.
    """

    where: str
    rows: int = 0
    used: int = 0
    left_out: Counter[str] = field(default_factory=Counter)
    first: dict[str, str] = field(default_factory=dict)
    ids: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def leave_out(self, reason: str, place: str, detail: str = "") -> None:
        """Counts a row that is not used."""
        self.left_out[reason] += 1
        self.first.setdefault(reason, f"{place}: {detail}" if detail else place)

    def note(self, sentence: str) -> None:
        """Keeps a sentence once."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def doubt(self, sentence: str) -> None:
        """Keeps a sentence that is said as a warning."""
        self.doubts.append(sentence)

    def sentences(self) -> list[str]:
        """What was left out, one sentence for each reason."""
        found = [
            f"{count} of {self.rows} readings {_REASONS[reason]} (first: {self.first[reason]})"
            for reason, count in self.left_out.items()
            if reason != UNKNOWN
        ]
        if self.left_out[UNKNOWN]:
            ids = ", ".join(f"{tag} ({count})" for tag, count in self.ids.most_common(8))
            found.append(
                f"{self.left_out[UNKNOWN]} of {self.rows} readings are with tags that name no robot: {ids};"
                f" map them with robots: {{{self.ids.most_common(1)[0][0]}: NAME}}, or list them as anchors"
            )
        return found

    def report(self) -> None:
        """Says it in the log: a warning for what may be a mistake, information for the rest."""
        level = logging.WARNING if self.left_out.keys() & _ALARMING or not self.used else logging.INFO
        for sentence in self.notes:
            logger.info("%s: %s", self.where, sentence)
        for sentence in self.doubts:
            logger.warning("%s: %s", self.where, sentence)
        if not self.rows:
            logger.warning("%s: it holds no readings", self.where)
        if self.left_out:
            logger.log(level, "%s: %d readings used; %s", self.where, self.used, "; ".join(self.sentences()))


UNREADABLE, EMPTY, LIMITS, FAR, INVALID = "unreadable", "empty", "limits", "far", "invalid"
UNKNOWN, ANCHOR, SAME, REPEATED, DEGREES = "unknown", "anchor", "same", "repeated", "degrees"
_REASONS = {
    UNREADABLE: "could not be read",
    EMPTY: "hold no range and no bearing",
    LIMITS: "lie outside range_limits",
    FAR: "lie beyond max_range",
    INVALID: "are marked as not valid",
    ANCHOR: "are with anchors",
    SAME: "are between tags of one robot",
    REPEATED: "repeat another",
    DEGREES: "have angles beyond a turn; for degrees add angle_unit: deg",
}
_ALARMING = {UNREADABLE, FAR, UNKNOWN, REPEATED, DEGREES}
