"""Looking up a name that a user typed."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import TypeVar

from wiclosure.errors import ConfigError

Value = TypeVar("Value")


def lookup(kind: str, name: str, table: Mapping[str, Value]) -> Value:
    """The entry of that name.

    Raises:
        ConfigError: there is none; the message suggests the nearest name and lists all.
    """
    if name in table:
        return table[name]
    near = difflib.get_close_matches(name.lower(), table, n=1, cutoff=0.4)
    hint = f"did you mean {near[0]}? " if near else ""
    raise ConfigError(f"unknown {kind} {name!r}: {hint}known are {', '.join(table)}")
