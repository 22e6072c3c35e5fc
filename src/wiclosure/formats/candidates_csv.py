"""`candidates.csv`: the pairs that a filter kept, one a line, with the stamps of both keyframes.

Columns `robot_a,index_a,stamp_a,robot_b,index_b,stamp_b,mahalanobis,overlap_probability`; stamps in seconds with nine
decimals, scores with six, `nan` where the filter predicts nothing.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.stamps import nanoseconds_of_column, seconds_text
from wiclosure.types import CandidatePairs, IntArray, Trajectory

HEADER = "robot_a,index_a,stamp_a,robot_b,index_b,stamp_b,mahalanobis,overlap_probability"
_ROWS_AT_A_TIME = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class StampedPairs:
    """Pairs of two robots as read from a file, with their stamps `(M,)` in nanoseconds."""

    pairs: CandidatePairs
    stamp_a_ns: IntArray
    stamp_b_ns: IntArray


def write_candidates(path: Path | str, pairs: Iterable[CandidatePairs], trajectories: Mapping[str, Trajectory]) -> None:
    """Writes all pairs.

    Args:
        path: file to write; replaced where it exists.
        pairs: kept pairs, as in `FilterResult.pairs`.
        trajectories: the keyframe trajectories that the indices refer to.

    Raises:
        OutputError: the file cannot be written.
    """
    try:
        with Path(path).open("w", encoding="utf-8", newline="") as file:
            file.write(HEADER + "\n")
            for of_robots in pairs:
                _write_robots(file, of_robots, trajectories)
    except OSError as error:
        raise OutputError(f"{path}: cannot write candidates ({error.strerror})") from error


def read_candidates(path: Path | str) -> tuple[StampedPairs, ...]:
    """Reads what `write_candidates` wrote, one entry for each pair of robots that occurs, in order.

    Raises:
        InputError: the file cannot be read, or is not such a table.
    """
    path = Path(path)
    table = _load(path)
    robots = np.stack([table["robot_a"], table["robot_b"]], axis=1)
    if len(table) == 0:
        return ()
    starts = np.concatenate([[0], np.flatnonzero((robots[1:] != robots[:-1]).any(axis=1)) + 1, [len(table)]])
    return tuple(_stamped(path, table[first:last]) for first, last in pairwise(starts))


def _write_robots(file: TextIO, pairs: CandidatePairs, trajectories: Mapping[str, Trajectory]) -> None:
    of_a, of_b = (_keyframe_texts(_quoted(r), trajectories[r]) for r in (pairs.robot_a, pairs.robot_b))
    for first in range(0, len(pairs), _ROWS_AT_A_TIME):
        rows = slice(first, first + _ROWS_AT_A_TIME)
        count = len(pairs.index_a[rows])
        # One formatting operation for all rows is twice as fast as one a row.
        fields: list[object] = [None] * (4 * count)
        fields[0::4], fields[1::4] = of_a[pairs.index_a[rows]].tolist(), of_b[pairs.index_b[rows]].tolist()
        fields[2::4], fields[3::4] = pairs.mahalanobis[rows].tolist(), pairs.overlap_probability[rows].tolist()
        file.write(("%s%s%.6f,%.6f\n" * count) % tuple(fields))


def _keyframe_texts(name: str, trajectory: Trajectory) -> NDArray[np.object_]:
    """`robot,index,stamp,` of every keyframe."""
    stamps = seconds_text(trajectory.stamps_ns.tolist())
    return np.array([f"{name},{index},{stamp}," for index, stamp in enumerate(stamps)], dtype=object)


def _quoted(name: str) -> str:
    """The name as a CSV field."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow([name])
    return line.getvalue()


def _load(path: Path) -> NDArray[np.void]:
    columns = HEADER.split(",")
    types = {"robot": "U256", "index": np.int64, "stamp": "S48"}
    dtype = np.dtype([(c, types.get(c.split("_")[0], np.float64)) for c in columns])
    try:
        with path.open(encoding="utf-8") as file:
            header = file.readline().strip()
            if header != HEADER:
                raise InputError(f"{path}: the first line is {header[:80]!r}; expected {HEADER}")
            text = file.read()
        if not text.strip():
            return np.zeros(0, dtype)
        return np.atleast_1d(np.loadtxt(io.StringIO(text), dtype, delimiter=",", quotechar='"', comments=None))
    except OSError as error:
        raise InputError(f"{path}: cannot read candidates ({error.strerror})") from error
    except ValueError as error:
        raise InputError(f"{path}: not a table of candidates ({error})") from error


def _stamped(path: Path, rows: NDArray[np.void]) -> StampedPairs:
    pairs = CandidatePairs(
        robot_a=str(rows["robot_a"][0]),
        robot_b=str(rows["robot_b"][0]),
        index_a=rows["index_a"].copy(),
        index_b=rows["index_b"].copy(),
        overlap_probability=rows["overlap_probability"].copy(),
        mahalanobis=rows["mahalanobis"].copy(),
    )
    try:
        return StampedPairs(
            pairs, nanoseconds_of_column(rows["stamp_a"].copy()), nanoseconds_of_column(rows["stamp_b"].copy())
        )
    except ValueError as error:
        raise InputError(f"{path}: a stamp is not a time in seconds ({error})") from error
