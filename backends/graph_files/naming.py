"""Whose pose a key names: GTSAM's symbols, labelled symbols, keys that the file explains, or plain numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from wiclosure.backends.graph_files.records import FileRecords

SYMBOL_SHIFT = 56  # GTSAM's symbols: a character in the first byte, the index in the others
LABEL_SHIFT = 48  # labelled symbols: another one in the second byte


class Pose(NamedTuple):
    """Robot, and the number that the file gives."""

    robot: str
    number: int


def pose_name(robot: str, index: int) -> str:
    """For the user: `a12` for symbols, `alpha 12` else."""
    letter = robot[:1]
    short = len(robot) == 1 or robot[1:2] == "."
    return f"{letter}{index}" if short and not letter.isdigit() else f"{robot} {index}"


class Naming:
    """Names all keys of some files.

    A key with a character in its first byte is one of GTSAM's symbols, and the character is the robot.  With something
    in its second byte too it is a labelled symbol, and the label is the robot (with the character before it, if there
    are several characters).  All other keys are plain numbers.  If no two files have a vertex in common, numbers name
    poses over all files, and a robot is called after the file that has its vertices; else each file has its own.
    The same goes for a symbol's character where two files state different measurements between the same poses.

    Args:
        files: all files of the team.

    Attributes:
        unnamed: robots that only a file's name tells, of which there may be several in the file.
    """

    def __init__(self, files: Sequence[FileRecords]) -> None:
        keys = {key for file in files for key in _keys(file)}
        self._characters = {character for character, label, _ in map(_symbol, keys) if label}
        self._owner: dict[int, FileRecords] = {}
        for file in reversed(files):
            self._owner |= {vertex.key: file for vertex in file.vertices}
        self._own = {""} if _plain_overlap(files) else set()
        self._own |= _contradicting_characters(files)
        self._files = _file_names(files)
        named = ((file, key) for file in files for key in _keys(file))
        self.unnamed = {self(file, key).robot for file, key in named if self._only_by_edges(file, key)}

    def __call__(self, file: FileRecords, key: int) -> Pose:
        """The pose that a key of a file names."""
        for robot, first, last in file.ranges:
            if first <= key <= last:
                return Pose(robot, key - first)
        if key in file.owners:
            return Pose(file.owners[key], key)
        character, label, index = _symbol(key)
        if character in self._own:
            return Pose(self._files[file.path], index)
        if not character:
            return Pose(self._files[self._owner.get(key, file).path], key)
        return Pose((label if len(self._characters) == 1 else character + label) if label else character, index)

    @property
    def numbers_per_file(self) -> bool:
        """Whether plain numbers are each file's own, so that no edge can join files."""
        return bool(self._own)

    def _only_by_edges(self, file: FileRecords, key: int) -> bool:
        return not _symbol(key)[0] and not _explained(file, key)


def _symbol(key: int) -> tuple[str, str, int]:
    """Character, label, index; empty where the key has none."""
    character = chr(key >> SYMBOL_SHIFT)
    if not character.isprintable() or character == " ":
        return "", "", key
    label = key >> LABEL_SHIFT & 0xFF
    index = key & ((1 << (LABEL_SHIFT if label else SYMBOL_SHIFT)) - 1)
    text = chr(label)
    return character, (text if text.isprintable() and text != " " else str(label)) if label else "", index


def _keys(file: FileRecords) -> Iterable[int]:
    yield from (vertex.key for vertex in file.vertices)
    for edge in file.edges:
        yield from (edge.first, edge.second)


def _plain_overlap(files: Sequence[FileRecords]) -> bool:
    plain = ({v.key for v in file.vertices if not _symbol(v.key)[0] and not _explained(file, v.key)} for file in files)
    count = Counter(key for keys in plain for key in keys)
    return bool(count) and max(count.values()) > 1


def _explained(file: FileRecords, key: int) -> bool:
    return key in file.owners or any(first <= key <= last for _, first, last in file.ranges)


def _contradicting_characters(files: Sequence[FileRecords]) -> set[str]:
    """Characters that two files use for different robots: between the same poses no measurement is alike."""
    stated: dict[tuple[int, int], list[set[bytes]]] = {}
    for file in files:
        of_file: dict[tuple[int, int], set[bytes]] = {}
        for edge in file.edges:
            if edge.first >> SYMBOL_SHIFT == edge.second >> SYMBOL_SHIFT:
                of_file.setdefault((edge.first, edge.second), set()).add(edge.T_first_second.tobytes())
        for ends, measured in of_file.items():
            stated.setdefault(ends, []).append(measured)
    alike: dict[str, bool] = {}
    for (first, _), sets in stated.items():
        if len(sets) > 1 and (character := _symbol(first)[0]):
            alike[character] = alike.get(character, False) or bool(set.intersection(*sets))
    return {character for character, same in alike.items() if not same}


def _file_names(files: Sequence[FileRecords]) -> dict[Path, str]:
    """What a robot is called after its file, unless a key of another file already calls one so."""
    told = {robot for file in files for robot in [*(r for r, _, _ in file.ranges), *file.owners.values()]}
    told |= {word for file in files for key in _keys(file) for word in _symbol(key)[:2]}
    return {file.path: file.path.name if file.name in told else file.name for file in files}
