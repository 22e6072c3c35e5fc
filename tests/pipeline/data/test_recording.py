from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.pipeline.data.recording import RobotRecording


@pytest.mark.parametrize(("seconds", "ns"), [(0.0, 0), (0.1, 100_000_000), (-2.5, -2_500_000_000), (1e-9, 1)])
def test_the_time_offset_in_nanoseconds(seconds: float, ns: int) -> None:
    assert RobotRecording(Path("a.bag"), time_offset=seconds).time_offset_ns == ns
