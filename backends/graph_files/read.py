"""Opens graph files of any format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from wiclosure.backends.graph_files.g2o import read_text_graph
from wiclosure.backends.graph_files.jrl import read_robot_log
from wiclosure.backends.graph_files.open import begins_as_json, stem
from wiclosure.backends.graph_files.records import FileRecords, Remarks
from wiclosure.errors import InputError

ROBOT_LOGS = {".jrl", ".json", ".cbor"}


def read_records(paths: Sequence[Path], remarks: Remarks) -> list[FileRecords]:
    """What stands in each file; its name, or a first character, tells the format: JSON Robot Log, or else text.

    Raises:
        InputError: a file cannot be read, is given twice, or is malformed.
    """
    paths = [Path(path) for path in paths]
    if twice := [path for n, path in enumerate(paths) if path.resolve() in {p.resolve() for p in paths[:n]}]:
        raise InputError(f"{twice[0]} is given twice; give each graph once")
    names = _names(paths)
    return [_reader(path)(path, name, remarks) for path, name in zip(paths, names, strict=True)]


def _reader(path: Path) -> Callable[[Path, str, Remarks], FileRecords]:
    is_log = ROBOT_LOGS & {suffix.lower() for suffix in path.suffixes[-2:]} or begins_as_json(path)
    return read_robot_log if is_log else read_text_graph


def _names(paths: Sequence[Path]) -> list[str]:
    """The stem of each file, with the folder before it where stems are alike, with a number where those are."""
    names = [stem(path) for path in paths]
    if len(set(names)) < len(names):
        names = [f"{path.parent.name}_{name}" for path, name in zip(paths, names, strict=True)]
    return [f"{name}_{n}" if names.count(name) > 1 else name for n, name in enumerate(names)]
