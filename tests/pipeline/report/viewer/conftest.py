"""What is in a recording, read back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("rerun", reason="the extra viz is not installed")


@pytest.fixture(scope="session")
def rows_of() -> Callable[[Path], Counter[str]]:
    """Rows over time of each entity in an `.rrd` file; entities that are static alone have none."""
    from rerun.chunk import RrdReader

    def read(path: Path) -> Counter[str]:
        rows: Counter[str] = Counter()
        for chunk in RrdReader(path).stream():
            rows[chunk.entity_path] += 0 if chunk.is_static else chunk.num_rows
        return rows

    return read
