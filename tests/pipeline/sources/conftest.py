"""Recordings to read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.types import Scan

START_NS = 1_700_000_000_000_000_000


def make_scans(count: int = 6, points: int = 300, *, timed: bool = True) -> list[Scan]:
    """Scans whose numbers all fit float32, at 10 Hz."""
    rng = np.random.default_rng(count)
    return [
        Scan(
            START_NS + number * 100_000_000,
            rng.normal(0, 20, (points, 3)).astype(np.float32).astype(np.float64),
            np.linspace(0, 0.1, points).astype(np.float32).astype(np.float64) if timed else None,
            rng.uniform(size=points).astype(np.float32),
        )
        for number in range(count)
    ]


@pytest.fixture(scope="session")
def scans() -> list[Scan]:
    return make_scans()


@pytest.fixture(scope="session")
def bags(tmp_path_factory: pytest.TempPathFactory, scans: list[Scan]) -> dict[str, Path]:
    """One recording of the same scans in each kind of bag."""
    from wiclosure.pipeline.data.dataset_writer import write_ros1_bag, write_ros2_bag

    folder = tmp_path_factory.mktemp("bags")
    paths = {"ros1": folder / "a.bag", "mcap": folder / "b_mcap", "sqlite3": folder / "c_sqlite3"}
    write_ros1_bag(paths["ros1"], scans)
    write_ros2_bag(paths["mcap"], scans, storage="mcap")
    write_ros2_bag(paths["sqlite3"], scans, storage="sqlite3")
    return paths
