"""In which order a file of poses has its columns, by the names in its first lines."""

from __future__ import annotations

import re
from pathlib import Path

from wiclosure.errors import InputError
from wiclosure.formats.text_table import is_number

POSE = ("stamp", "x", "y", "z", "qx", "qy", "qz", "qw")
_SAMPLE = 20_000  # characters, in which names are looked for


def line_of_names(text: str) -> str:
    """The first line, also of a comment, that names at least eight columns; empty where none does."""
    return next((line for line in text[:_SAMPLE].splitlines() if _names(line)), "")


def pose_order(path: Path, line: str, default: tuple[str, ...]) -> list[int]:
    """Where `x y z qx qy qz qw` stand among the first eight columns, 0 being that of the stamp.

    Args:
        path: the file, in messages.
        line: names the columns, as `tx`, `q_RS_w []` or `orientation.w`; empty, or other words: as by default.
        default: `POSE` in the order that the format has.

    Raises:
        InputError: the stamp is not the first.
    """
    names = _names(line)
    roles = tuple(_role(name) for name in names[: len(POSE)])
    if sorted(roles) != sorted(POSE):
        roles = default
    if roles[0] != "stamp":
        raise InputError(f"{path}: its columns are {', '.join(names)}; expected the stamp first ({' '.join(POSE)})")
    return [roles.index(column) for column in POSE[1:]]


def _names(line: str) -> list[str]:
    content = line.strip().lstrip("#").strip()
    cells = re.split(r"\s*[,;]\s*" if re.search("[,;]", content) else r"\s+", content)
    return [] if len(cells) < len(POSE) or any(map(is_number, cells)) else [cell.strip("\"'") for cell in cells]


def _role(name: str) -> str:
    plain = re.sub(r"\[.*?\]|\(.*?\)|[^a-z]", "", name.lower())
    if plain == "t" or "time" in plain or "stamp" in plain or plain.startswith("sec"):
        return "stamp"
    axis = plain[-1:] if plain[-1:] in {"x", "y", "z", "w"} else ""
    turns = axis == "w" or plain.startswith("q") or re.search("quat|orient|rot", plain) is not None
    return f"q{axis}" if turns else axis
