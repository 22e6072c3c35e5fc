"""One thing that a check found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

Topic: TypeAlias = Literal["overlap", "clock", "unit", "steps", "fit", "noise", "bearing", "gaps", "repeated", "motion"]
Level: TypeAlias = Literal["good", "note", "suspect"]


@dataclass(frozen=True, slots=True)
class Finding:
    """A sentence, and what to write where something is to be corrected.

    Args:
        topic: what it is about.
        level: `good`: this fits; `note`: for information, or not to be told from the data; `suspect`: probably wrong.
        text: the sentence, with its figures.
        pair: the robots it is about, or None for the log.
        settings: keys of the source to add, with their values.
    """

    topic: Topic
    level: Level
    text: str
    pair: tuple[str, str] | None = None
    settings: Mapping[str, object] = field(default_factory=dict)

    @property
    def advice(self) -> str:
        """`add unit: mm`, or nothing."""
        stated = ", ".join(f"{key}: {value}" for key, value in self.settings.items())
        return f"add {stated}" if stated else ""
