"""Looking up a name that a user typed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from wiclosure.errors import ConfigError
from wiclosure.suggestions import did_you_mean

Value = TypeVar("Value")


def lookup(kind: str, name: str, table: Mapping[str, Value]) -> Value:
    """The entry of that name.

    Raises:
        ConfigError: there is none; the message suggests the nearest name and lists all.
    """
    if name in table:
        return table[name]
    raise ConfigError(f"unknown {kind} {name!r}: {did_you_mean(name, table)}known are {', '.join(table)}")
