"""Values of a JSON record, each checked when it is read: what is wrong is said with the key and the value.

All raise InputError.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from decimal import Decimal
from typing import Any, TypeAlias, TypeVar

from wiclosure.errors import InputError

Record: TypeAlias = Mapping[str, Any]
"""A JSON object; its decimals may be `Decimal`, so that nothing is lost."""

_NUMBERS = (Decimal, int, float)
_Value = TypeVar("_Value")


def optional(record: Record, key: str, read: Callable[[Record, str], _Value]) -> _Value | None:
    """What `read` makes of a value; None where it is null or absent."""
    return None if record.get(key) is None else read(record, key)


def number(record: Record, key: str) -> float:
    """A finite number; NaN and Infinity, which Python's JSON lets through, are not."""
    value = record[key]
    if type(value) not in _NUMBERS:  # type(): a boolean is an integer too, but no number
        raise InputError(f'"{key}" is {shown(value)}; expected a number')
    try:
        finite = float(value)
    except OverflowError:
        finite = math.inf
    if not math.isfinite(finite):
        raise InputError(f'"{key}" is {shown(value)}; expected a finite number (use null where there is none)')
    return finite


def name(record: Record, key: str) -> str:
    """A text that is not empty."""
    value = record[key]
    if not isinstance(value, str) or not value:
        raise InputError(f'"{key}" is {shown(value)}; expected a name')
    return value


def vector(record: Record, key: str) -> tuple[float, float, float]:
    """Three finite numbers."""
    value = record[key]
    if not isinstance(value, list) or len(value) != 3:
        raise InputError(f'"{key}" is {shown(value)}; expected [x, y, z] in metres')
    x, y, z = (number({key: component}, key) for component in value)
    return x, y, z


def shown(value: object) -> str:
    """A value as it stands in the file, cut where it is long."""
    text = str(value) if isinstance(value, Decimal) else json.dumps(value, default=str)
    return text if len(text) <= 60 else f"{text[:57]}..."
