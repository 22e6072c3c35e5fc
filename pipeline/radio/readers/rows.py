"""What a reader of any kind hands on: one row of raw values a measurement, still in the log's own words and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

Values: TypeAlias = Mapping[str, Any]
"""Raw values by the key of `RadioSource` whose field they come from; `range_low` and `range_high` are its limits."""


@dataclass(frozen=True, slots=True)
class Row:
    """One row: where it stands (`line 7`, `/uwb message 12`), and its values; None: not readable, with the reason."""

    place: str
    values: Values
    problem: str | None = None


@dataclass(frozen=True, slots=True)
class ReceivedAt:
    """When a bag received a message, in the place of a stamp."""

    stamp_ns: int
