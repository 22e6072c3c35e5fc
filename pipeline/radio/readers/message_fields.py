"""Fields of messages by their paths: `header.stamp`, `nodes[].dis`, `ranges[0]`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from wiclosure.errors import ConfigError, InputError

_STEP = re.compile(r"(?P<name>[A-Za-z_]\w*)(?P<index>(\[\d*\])?)")


@dataclass(frozen=True, slots=True)
class FieldPath:
    """One path; `[]` stands for each element of an array."""

    text: str
    steps: tuple[tuple[str, int | None, bool], ...]

    @classmethod
    def parsed(cls, text: str) -> FieldPath:
        """The path in a text.

        Raises:
            ConfigError: it is none, or goes through two arrays.
        """
        steps: list[tuple[str, int | None, bool]] = []
        for part in text.split("."):
            match = _STEP.fullmatch(part)
            if match is None:
                raise ConfigError(f"{text!r} is no field of a message; expected a path such as nodes[].dis")
            index = match["index"][1:-1] if match["index"] else ""
            steps.append((match["name"], int(index) if index else None, match["index"] == "[]"))
        if sum(each for _, _, each in steps) > 1:
            raise ConfigError(f"field {text!r} goes through two arrays; one `[]` is possible")
        return cls(text, tuple(steps))

    @property
    def is_array(self) -> bool:
        """Whether it has a value for each element of an array."""
        return any(each for _, _, each in self.steps)

    def of(self, message: object) -> Any:
        """The value, or a list of them for an array.

        Raises:
            InputError: the message has no such field.
        """
        return self._from(message, 0)

    def _from(self, value: object, step: int) -> Any:
        for number in range(step, len(self.steps)):
            name, index, each = self.steps[number]
            if name not in (known := _names(value)):
                if isinstance(value, list | np.ndarray):
                    here = ".".join(part[0] for part in self.steps[:number])
                    raise InputError(f"{here!r} of {self.text!r} is an array; write {here}[].{name} for each element")
                fields_there = ", ".join(known) or "none"
                raise InputError(f"{_type(value)} has no field {name!r} (of {self.text!r}); its fields: {fields_there}")
            value = getattr(value, name)
            if each or index is not None:
                if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str):
                    raise InputError(f"field {name!r} of {self.text!r} is no array; leave the [] out")
                if each:
                    return [self._from(element, number + 1) for element in value]
                value = value[index] if index is not None and index < len(value) else None
        return value


def rows_of(message: object, paths: Mapping[str, FieldPath]) -> Iterator[dict[str, Any]]:
    """Values by key: one row, or one for each element where paths go through arrays (all of one length).

    Raises:
        InputError: a field is missing, or arrays differ in length.
    """
    values = {key: path.of(message) for key, path in paths.items()}
    arrays = {key for key, path in paths.items() if path.is_array}
    lengths = {len(values[key]) for key in arrays}
    if len(lengths) > 1:
        raise InputError(f"the arrays of {', '.join(paths[key].text for key in sorted(arrays))} differ in length")
    for element in range(lengths.pop() if lengths else 1):
        yield {key: value[element] if key in arrays else value for key, value in values.items()}


def field_paths(message: object, above: str = "") -> list[str]:
    """The paths of all fields of a message, arrays of messages by their first element."""
    found: list[str] = []
    for name in _names(message):
        value, path = getattr(message, name), f"{above}{name}"
        if isinstance(value, list | np.ndarray):
            path += "[]"
            value = value[0] if len(value) else None
        is_time = {"sec", "nanosec"} <= set(_names(value))  # read as one
        found += (not is_time and field_paths(value, f"{path}.")) or [path]
    return found


def _names(value: object) -> list[str]:
    """Names of fields, without the constants that rosbags keeps beside them."""
    return [field.name for field in fields(value) if field.name != "__msgtype__"] if is_dataclass(value) else []


def _type(value: object) -> str:
    return str(getattr(value, "__msgtype__", type(value).__name__))
