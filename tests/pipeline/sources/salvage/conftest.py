"""Recordings of the same scans, whole, to be damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.types import Scan

START_NS = 1_700_000_000_000_000_000
COUNT = 12


@pytest.fixture(scope="session")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One file of each kind, with 12 messages a tenth of a second apart."""
    from wiclosure.pipeline.data.dataset_writer import write_ros1_bag, write_ros2_bag

    rng = np.random.default_rng(0)
    scans = [Scan(START_NS + k * 10**8, rng.normal(0, 9, (400, 3))) for k in range(COUNT)]
    folder = tmp_path_factory.mktemp("salvage")
    write_ros1_bag(folder / "a.bag", scans)
    write_ros2_bag(folder / "b", scans, storage="mcap")
    write_ros2_bag(folder / "c", scans, storage="sqlite3")
    (mcap,), (sqlite3,) = (folder / "b").glob("*.mcap"), (folder / "c").glob("*.db3")
    return {"ros1": folder / "a.bag", "mcap": mcap, "sqlite3": sqlite3}
