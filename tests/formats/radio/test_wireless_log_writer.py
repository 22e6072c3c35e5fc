from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import OutputError
from wiclosure.formats.radio.wireless_log import read_wireless_log
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.types import AoaPath, Heading, WirelessLog, WirelessMeasurement

LOG = WirelessLog(
    (
        WirelessMeasurement(1_700_000_000_123_456_789, "alpha", "beta", 23.41, 0.5),
        WirelessMeasurement(
            1_700_000_001_000_000_001, "beta", "alpha", None, None, (AoaPath(0.31, 0.1745, 0.62, 0.1),), "world",
            transmitter_stamp_ns=5, lever_arm_receiver=(0.1, 0.0, 0.3),
        ),
    ),
    (Heading(1_700_000_000_500_000_000, "alpha", 1.57, 0.05),),
)  # fmt: skip


def test_what_is_written_is_read_again_to_the_last_digit(tmp_path: Path) -> None:
    write_wireless_log(tmp_path / "w.jsonl", LOG)
    assert read_wireless_log(tmp_path / "w.jsonl") == LOG
    kinds = [line.split('"')[3] for line in (tmp_path / "w.jsonl").read_text().splitlines()]
    assert kinds == ["wireless", "heading", "wireless"]  # in order of time


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="nowhere"):
        write_wireless_log(tmp_path / "nowhere" / "w.jsonl", LOG)
