"""In which order a file of poses has its columns, by the names in its first lines."""

from __future__ import annotations

import re
from pathlib import Path

from wiclosure.errors import InputError
from wiclosure.formats.radio.radio_units import TimeUnit, is_fraction, time_unit_in
from wiclosure.formats.text_cells import is_number

POSE = ("stamp", "x", "y", "z", "qx", "qy", "qz", "qw")
_SAMPLE = 20_000  # characters, in which names are looked for


def line_of_names(text: str) -> str:
    """The first line, also of a comment, that names at least eight columns; empty where none does."""
    return next((line for line in text[:_SAMPLE].splitlines() if _names(line)), "")


def pose_columns(path: Path, line: str, default: tuple[str, ...]) -> list[int]:
    """Where `stamp x y z qx qy qz qw` stand in a row.

    Args:
        path: the file, in messages.
        line: names the columns, as `tx`, `q_RS_w []` or `orientation.w`; empty, or words of a remark: as by default.
        default: `POSE` in the order that the format has.

    Raises:
        InputError: names that are not behind a remark's mark, and miss one of the columns.
    """
    names = _names(line)
    roles = _roles(names)
    if set(POSE) <= set(roles):
        if "fraction" in roles:
            raise InputError(f"{path} has seconds and nanoseconds in two columns; write them as one number of seconds")
        return [roles.index(column) for column in POSE]
    if names and not line.lstrip().startswith("#"):
        raise InputError(
            f"{path}: of its columns ({', '.join(names[:20])}) none is {_missing(roles)}; expected {' '.join(POSE)}"
        )
    return [default.index(column) for column in POSE]


def stated_unit(line: str) -> TimeUnit | None:
    """The unit of the stamps by the name of their column, as `stamp [ns]` or `time_us`; None where it tells none."""
    names = _names(line)
    roles = _roles(names)
    return time_unit_in(names[roles.index("stamp")]) if set(POSE) <= set(roles) else None


def _missing(roles: list[str]) -> str:
    return " or ".join(column for column in POSE if column not in roles)


def _names(line: str) -> list[str]:
    content = line.strip().lstrip("#").strip()
    if not re.search("[,;]", content):
        content = re.sub(r"\s+(\[\S*?\]|\(\S*?\))", r"\1", content)  # units belong to the names before them
        content = re.sub(r"\s+(\[.*?\]|\(.*?\))", "", content)
    cells = re.split(r"\s*[,;]\s*" if re.search("[,;]", content) else r"\s+", content)
    return [] if len(cells) < len(POSE) or any(map(is_number, cells)) else [cell.strip("\"'") for cell in cells]


def _roles(names: list[str]) -> list[str]:
    """What each column is; nanoseconds beside seconds are their fraction, and alone the stamps."""
    roles = [_role(name) for name in names]
    return roles if "stamp" in roles else ["stamp" if role == "fraction" else role for role in roles]


def _role(name: str) -> str:
    if is_fraction(name):
        return "fraction"
    plain = re.sub(r"\[.*?\]|\(.*?\)|[^a-z]", "", name.lower())
    if re.fullmatch(r"ts?([mun]?s)?", plain) or "time" in plain or "stamp" in plain or plain.startswith("sec"):
        return "stamp"
    axis = plain[-1:] if plain[-1:] in {"x", "y", "z", "w"} else ""
    turns = axis == "w" or plain.startswith("q") or re.search("quat|orient|rot", plain) is not None
    return f"q{axis}" if turns else axis
