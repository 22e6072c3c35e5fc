"""What lies in a folder: recordings, trajectories, radio logs, data set files, and what nobody knows."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from wiclosure.errors import InputError, WiclosureError
from wiclosure.formats.text_cells import is_number
from wiclosure.formats.text_table import TextTable, open_table
from wiclosure.formats.trajectories.pose_columns import pose_columns
from wiclosure.formats.trajectories.trajectory_file import read_trajectory, trajectory_kind
from wiclosure.pipeline.data.dataset_file import DATASET_FILE
from wiclosure.pipeline.radio.presets import preset_of_header
from wiclosure.pipeline.radio.readers.column_names import guess
from wiclosure.pipeline.radio.unused import UnusedRadio, unused_radio
from wiclosure.pipeline.sources.bag_files import METADATA, bag_kind
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.folder import layouts_of
from wiclosure.pipeline.sources.info import RecordingInfo, recording_info
from wiclosure.pipeline.sources.open import LOADERS

FileKind: TypeAlias = Literal["recording", "trajectory", "radio", "data set", "unknown"]

_DEPTH = 2
_TEXT = {".csv", ".tsv", ".txt", ".tum", ".log", ".dat", ".jsonl", ".pyfg"}
_BAGS = {".bag", ".mcap", ".db3"}
_FEW_ROWS = 5
_OVERLAP_NS = 10**9  # parts of one recording overlap by less: messages that wait are written late
_PARTS = re.compile(r"^(metadata\.yaml|times\.txt|timestamps\.txt|poses\.txt|calib.*\.txt)$")


@dataclass(frozen=True, slots=True)
class Found:
    """One file or folder.

    Args:
        path: where it is.
        kind: what it is taken for.
        holds: what is in it, a few words.
        recording: of a recording, its topics and counts.
        radio: topics of a bag that look like radio and are in no known form.
        layouts: of a folder of `.bin` files in another layout than KITTI's, those that it may have.
    """

    path: Path
    kind: FileKind
    holds: str
    recording: RecordingInfo | None = None
    radio: tuple[UnusedRadio, ...] = ()
    layouts: tuple[str, ...] = ()


def survey(folder: Path, *, salvage: bool = False) -> list[Found]:
    """Everything in a folder, and one below, in order of names.

    Raises:
        InputError: there is no such folder.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is no folder; name the one that holds the recordings")
    return list(_within(folder, _DEPTH, salvage=salvage))


def is_recording(path: Path) -> bool:
    """Whether a path is one recording, and not a folder in which bags of several robots lie beside other files."""
    if not any(loader.recognises(path) for loader in LOADERS.values()):
        return False
    if path.is_file() or bag_kind(path) is None or (path / METADATA).is_file():
        return not (path / DATASET_FILE).is_file()
    files = [file for file in path.iterdir() if not file.name.startswith(".")]
    names = {re.sub(r"[_.-]?\d+$", "", file.name.split(".")[0]) for file in files}
    if len(names) > 1 or not all(file.is_file() and bag_kind(file) for file in files):
        return False
    return not _at_once(files)


def _at_once(files: Sequence[Path]) -> bool:
    """Whether bags were recorded at the same time, as those of several robots are; parts of one follow each other."""
    spans: list[tuple[int, int]] = []
    for file in files:
        try:
            with open_bag(file) as bag:
                spans.append((bag.start_ns, bag.end_ns))
        except WiclosureError:
            return False  # what is wrong is said where the folder is read
    spans.sort()
    return any(
        min(end, next_end) - next_start > min(_OVERLAP_NS, (end - start) // 2, (next_end - next_start) // 2)
        for (start, end), (next_start, next_end) in pairwise(spans)
    )


def _within(folder: Path, depth: int, *, salvage: bool) -> Iterator[Found]:
    for path in sorted(folder.iterdir()):
        if path.name.startswith("."):
            continue
        try:
            if is_recording(path):
                yield _recording(path, salvage=salvage)
            elif path.is_dir():
                if depth > 1:
                    yield from _within(path, depth - 1, salvage=salvage)
            elif not _PARTS.match(path.name):
                yield survey_file(path)
        except OSError as error:
            yield Found(path, "unknown", f"cannot be read: {error.strerror or error}")


def _recording(path: Path, *, salvage: bool) -> Found:
    try:
        found = recording_info(path, salvage=salvage)
        radio = tuple(unused_radio(path, (), salvage=salvage)) if bag_kind(path) else ()
    except WiclosureError as error:
        layouts = () if bag_kind(path) else tuple(layouts_of(path))
        return Found(path, "recording", f"cannot be read: {error}", layouts=layouts)
    what = f"{found.kind}, {found.duration_s:.0f} s, {found.count:,} {'messages' if found.topics else 'scans'}"
    return Found(path, "recording", what, found, radio)


def survey_file(path: Path) -> Found:
    """What a file is that is no recording."""
    if path.name == DATASET_FILE:
        return Found(path, "data set", "robots and radio logs by name")
    if path.suffix.lower() in _BAGS:
        return Found(path, "unknown", "by its first bytes no bag")
    if path.suffix.lower() not in _TEXT:
        return Found(path, "unknown", f"{path.suffix or 'no ending'}: not read")
    try:
        return _text(path)
    except WiclosureError:
        return Found(path, "unknown", "text that is no table")


def _text(path: Path) -> Found:
    with path.open("rb") as file:
        head = file.read(256).lstrip()
    if head.startswith(b"{"):
        return Found(path, "radio", "wireless log (JSON Lines)")
    if head.startswith((b"VERTEX_", b"EDGE_")):
        is_graph = b"EDGE_RANGE" in path.read_bytes()
        return Found(path, "radio" if is_graph else "unknown", "factor graph" + ("" if is_graph else " without ranges"))
    return _table(path, open_table(path))


def _table(path: Path, table: TextTable) -> Found:
    rows = [cells for _, (_, cells) in zip(range(_FEW_ROWS), table.rows(), strict=False)]
    kind = trajectory_kind(path)
    if kind == "kitti":
        return Found(path, "unknown", "KITTI poses without stamps: ground_truth of a folder of as many scans")
    if kind == "euroc" or _are_poses(rows) or _name_poses(table.columns):
        return _trajectory(path)
    known = guess(table.columns, table.units) if table.has_header else {}
    if preset := preset_of_header(table.columns):
        return Found(path, "radio", f"table as of preset {preset.name}")
    if "stamp" in known and known.keys() & {"range", "azimuth"}:
        named = ", ".join(f"{key}: {value}" for key, value in known.items())
        return Found(path, "radio", f"table ({named})")
    return Found(path, "unknown", f"table of {len(table.columns)} columns: {', '.join(table.columns[:6])}")


def _trajectory(path: Path) -> Found:
    try:
        trajectory = read_trajectory(path, path.stem)
    except InputError as error:
        return Found(path, "unknown", f"poses that cannot be read: {error}")
    length_m, span_s = trajectory.distance[-1], (trajectory.stamps_ns[-1] - trajectory.stamps_ns[0]) * 1e-9
    kind = "EuRoC" if trajectory_kind(path) == "euroc" else "TUM"
    return Found(path, "trajectory", f"{len(trajectory)} poses ({kind}), {span_s:.0f} s, {length_m:.0f} m")


def _name_poses(columns: Sequence[str]) -> bool:
    try:
        pose_columns(Path(), ",".join(columns), ())
    except (InputError, ValueError):
        return False
    return True


def _are_poses(rows: list[list[str]]) -> bool:
    """Whether rows begin with `stamp x y z qx qy qz qw`: eight numbers, the last four of length one."""
    if not rows or not all(len(row) >= 8 and all(map(is_number, row[:8])) for row in rows):
        return False
    quaternions = np.array([[float(cell.replace(",", ".")) for cell in row[4:8]] for row in rows])
    return bool(np.allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=0.05))
