"""Whose pose a key names: GTSAM's symbols, labelled symbols, keys that the file explains, or plain numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wiclosure.backends.graph_files.records import Edge, FileRecords
from wiclosure.types import FloatArray

SYMBOL_SHIFT = 56  # GTSAM's symbols: a character in the first byte, the index in the others
SAME = 1e-3  # what two programs may write differently of one measurement
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
    poses over all files, and a robot is called after the file that has its vertices (without vertices, the file with
    most of its edges); else each file has its own.  The same goes for a symbol's character, and for the numbers of
    files of edges alone, where two files state different measurements between the same poses.

    Args:
        files: all files of the team.

    Attributes:
        unnamed: robots that only a file's name tells, of which there may be several in the file.
    """

    def __init__(self, files: Sequence[FileRecords]) -> None:
        keys = [_keys(file) for file in files]
        symbols = {_symbol(key)[:2] for of_file in keys for key in of_file}
        self._characters = {character for character, label in symbols if label}
        self._owner = _owners(files)
        self._own = {""} if _plain_overlap(files) else set()
        self._own |= _contradicting_characters(files)
        self._files = _file_names(files, {word for symbol in symbols for word in symbol})
        named = ((file, key) for file, of_file in zip(files, keys, strict=True) for key in of_file)
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


@lru_cache(maxsize=1 << 20)
def _symbol(key: int) -> tuple[str, str, int]:
    """Character, label, index; empty where the key has none."""
    character = chr(key >> SYMBOL_SHIFT)
    if not character.isprintable() or character == " ":
        return "", "", key
    label = key >> LABEL_SHIFT & 0xFF
    index = key & ((1 << (LABEL_SHIFT if label else SYMBOL_SHIFT)) - 1)
    text = chr(label)
    return character, (text if text.isprintable() and text != " " else str(label)) if label else "", index


def _keys(file: FileRecords) -> set[int]:
    return {v.key for v in file.vertices} | {key for edge in file.edges for key in (edge.first, edge.second)}


def _owners(files: Sequence[FileRecords]) -> dict[int, FileRecords]:
    """The first file that has a vertex of each key; where none has, the one that says most of the pose.

    An edge says as much as others in its file make its leap from number to number, times those of the most frequent
    leap that state its matrix: odometry has one leap where robots count for themselves or in turn.
    """
    listed = {vertex.key: file for file in reversed(files) for vertex in file.vertices}
    said: dict[int, Counter[int]] = {}
    for n, file in enumerate(files):
        leaps = Counter(map(_leap, file.edges))
        usual = max(leaps.values(), default=0)
        matrices = Counter(_stated(edge) for edge in file.edges if leaps[_leap(edge)] == usual)
        for edge in file.edges:
            for key in (edge.first, edge.second):
                said.setdefault(key, Counter())[n] += leaps[_leap(edge)] * (1 + matrices[_stated(edge)])
    return {key: files[of_key.most_common(1)[0][0]] for key, of_key in said.items()} | listed


def _leap(edge: Edge) -> int:
    return abs(edge.first - edge.second)


def _stated(edge: Edge) -> bytes:
    return b"" if edge.information is None else edge.information.tobytes()


def _plain_overlap(files: Sequence[FileRecords]) -> bool:
    plain = ({v.key for v in file.vertices if not _symbol(v.key)[0] and not _explained(file, v.key)} for file in files)
    count = Counter(key for keys in plain for key in keys)
    return bool(count) and max(count.values()) > 1


def _explained(file: FileRecords, key: int) -> bool:
    return key in file.owners or any(first <= key <= last for _, first, last in file.ranges)


def _contradicting_characters(files: Sequence[FileRecords]) -> set[str]:
    """Characters that two files use for different robots: between the same poses no measurement is alike."""
    edges_alone = not any(file.vertices for file in files)  # of plain numbers, vertices tell more surely
    stated: dict[tuple[int, int], list[tuple[int, FloatArray]]] = {}
    for n, file in enumerate(files):
        for edge in file.edges:
            if edge.first >> LABEL_SHIFT == edge.second >> LABEL_SHIFT:
                stated.setdefault((edge.first, edge.second), []).append((n, edge.T_first_second))
    alike: dict[str, bool] = {}
    for (first, _), measured in stated.items():
        (n, T), (character, label, _) = measured[0], _symbol(first)
        others = [other for m, other in measured[1:] if m != n]
        if (character or edges_alone) and not label and others:
            same = any(np.allclose(T, other, rtol=0, atol=SAME) for other in others)
            alike[character] = alike.get(character, False) or same
    return {character for character, same in alike.items() if not same}


def _file_names(files: Sequence[FileRecords], told: set[str]) -> dict[Path, str]:
    """What a robot is called after its file, unless something in the files already calls one so."""
    told |= {robot for file in files for robot in [*(r for r, _, _ in file.ranges), *file.owners.values()]}
    return {file.path: file.path.name if file.name in told else file.name for file in files}
