"""Scans that no odometry can use are left out, counted and reported."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.dataset_writer import write_ros1_bag
from wiclosure.pipeline.sources.checked import CheckedSource
from wiclosure.pipeline.sources.open import open_source
from wiclosure.types import Scan


@dataclass
class Listed:
    """Scans from a list; announces one more if told to."""

    scans: list[Scan]
    announced: int

    @property
    def description(self) -> str:
        return "list"

    def __len__(self) -> int:
        return self.announced

    def __iter__(self) -> Iterator[Scan]:
        return iter(self.scans)


def test_good_scans_pass_and_nothing_is_said(scans: list[Scan]) -> None:
    checked = CheckedSource(Listed(scans, len(scans)))
    assert isinstance(checked, ScanSource)
    assert list(checked) == scans
    assert checked.diagnosis == ()


def test_unusable_scans_are_counted_each_time(scans: list[Scan]) -> None:
    empty = Scan(scans[1].stamp_ns + 1, np.zeros((0, 3)))
    again = replace(scans[2], stamp_ns=scans[1].stamp_ns)
    back = replace(scans[3], stamp_ns=scans[0].stamp_ns + 5)
    checked = CheckedSource(Listed([scans[0], scans[1], empty, again, back, back, scans[4]], 8))
    for _ in range(2):
        assert list(checked) == [scans[0], scans[1], scans[4]]
        assert checked.diagnosis == (
            "list: 1 of 7 scans had no valid points and were skipped.",
            "list: 2 of 7 scans had stamps that go back in time and were skipped.",
            "list: 1 of 7 scans repeated the stamp before and were skipped.",
            "list: Only 7 of 8 announced scans could be read.",
        )


def test_all_nan_clouds_in_a_bag(tmp_path: Path, scans: list[Scan]) -> None:
    nothing = replace(scans[2], points=np.full_like(scans[2].points, np.nan))
    write_ros1_bag(tmp_path / "a.bag", [*scans[:2], nothing, *scans[3:]])
    checked = CheckedSource(open_source(tmp_path / "a.bag"))
    assert [scan.stamp_ns for scan in checked] == [s.stamp_ns for s in scans if s is not scans[2]]
    assert len(checked.diagnosis) == 1
    assert "1 of 6 scans had no valid points" in checked.diagnosis[0]


def test_nothing_usable_is_said() -> None:
    checked = CheckedSource(Listed([Scan(1, np.zeros((0, 3)))], 1))
    assert list(checked) == []
    assert checked.diagnosis[-1] == "list: No scan could be used."
