"""Ranges of PyFactorGraph text (`.pyfg`), the range-aided SLAM format of MarineRoboticsGroup/PyFactorGraph.

```
VERTEX_SE2 0.10 A0 0.0 0.0 0.0            poses, named by the robot's letter and a number; VERTEX_SE3:QUAT in space
VERTEX_XY L0 2.5 0.5                      landmarks, whose letter is L
EDGE_SE2 0.10 A0 A1 1.0 0.1 0.4 ...       odometry and closures
EDGE_RANGE 2.10 A2 B5 0.85 0.01           stamp (s), two vertices, range (m), variance (m^2)
```
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from wiclosure.errors import InputError

WORDS = ("VERTEX_SE2", "VERTEX_SE3:QUAT", "VERTEX_XY", "VERTEX_XYZ", "EDGE_SE2", "EDGE_SE3:QUAT", "EDGE_RANGE")
_VERTEX = re.compile(r"([A-Za-z]+)(\d+)")


@dataclass(frozen=True, slots=True)
class PyfgRange:
    """One EDGE_RANGE line: its number, its words, or the sentence that says why they are none."""

    line: int
    stamp: str = ""
    receiver: str = ""
    transmitter: str = ""
    range: str = ""
    variance: str = ""
    problem: str | None = None


def read_pyfg_ranges(path: Path) -> Iterator[PyfgRange]:
    """The range measurements, robots named by their letter and landmarks in full (`A`, `L0`).

    Raises:
        InputError: the file cannot be read, or is no text.
    """
    try:
        with path.open(encoding="utf-8-sig") as file:
            for number, line in enumerate(file, start=1):
                words = line.split()
                if words and words[0] == "EDGE_RANGE":
                    yield _range(number, words)
    except OSError as error:
        raise InputError(f"cannot read the factor graph {path}: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no text ({error}); expected a factor graph of PyFactorGraph") from error


def _range(number: int, words: list[str]) -> PyfgRange:
    if len(words) != 6:
        return PyfgRange(number, problem=f"EDGE_RANGE with {len(words)} words, expected 6")
    names = [_robot(word) for word in words[2:4]]
    if None in names:
        return PyfgRange(number, problem=f"{words[2]} {words[3]} are no vertices (a letter and a number)")
    return PyfgRange(number, words[1], str(names[0]), str(names[1]), words[4], words[5])


def _robot(vertex: str) -> str | None:
    """`A` of `A12`; a landmark keeps its number, for each stands elsewhere."""
    match = _VERTEX.fullmatch(vertex)
    if match is None:
        return None
    return vertex if match[1] == "L" else match[1]
