"""Reads recordings record by record, without an index: not closed, without their end, or described wrongly.

A scanner yields every message that is whole, in the order of the file, and never raises for damage: it takes it down,
skips a chunk that does not decompress, and stops where the records end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Protocol

from wiclosure.pipeline.sources.salvage.found import Damage, FoundMessage, TopicChoice, everything
from wiclosure.pipeline.sources.salvage.mcap import scan_mcap
from wiclosure.pipeline.sources.salvage.ros1 import scan_ros1
from wiclosure.pipeline.sources.salvage.sqlite import scan_sqlite3


class Scanner(Protocol):
    """Reads one kind of file."""

    def __call__(self, path: Path, damage: Damage, wanted: TopicChoice = everything) -> Iterator[FoundMessage]:
        """All whole messages; data of topics that are not wanted may be left out where that saves time."""


_SCANNERS: Mapping[str, Scanner] = {"ros1": scan_ros1, "mcap": scan_mcap, "sqlite3": scan_sqlite3}


def scan_file(path: Path, kind: str, damage: Damage, wanted: TopicChoice = everything) -> Iterator[FoundMessage]:
    """All whole messages of one file of the given kind (`ros1`, `mcap` or `sqlite3`); `damage` takes down the rest."""
    return _SCANNERS[kind](path, damage, wanted)
