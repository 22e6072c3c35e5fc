from __future__ import annotations

import io

import pytest
from rich.console import Console
from rich.table import Table

from wiclosure.pipeline.radio.check.check import CheckResult
from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.presets import presets
from wiclosure.pipeline.radio.read import RadioReading
from wiclosure.pipeline.radio.readers.account import Account
from wiclosure.pipeline.report.radio_tables import check_table, presets_table, radio_table
from wiclosure.types import AoaPath, Heading, WirelessLog, WirelessMeasurement


def shown(table: Table, width: int = 160) -> str:
    out = io.StringIO()
    Console(file=out, width=width, color_system=None).print(table)
    return out.getvalue()


def cells(text: str, robots: str) -> list[str]:
    (line,) = (line for line in text.splitlines() if robots in line)
    return [word.strip() for word in line.split("│")][1:-1]


def measurement(seconds: float, receiver: str, transmitter: str, range_m: float | None, *paths: AoaPath):
    sigma = None if range_m is None else 0.25
    return WirelessMeasurement(round(seconds * 1e9), receiver, transmitter, range_m, sigma, paths)


def test_a_log_is_shown_pair_by_pair_with_what_was_left_out() -> None:
    measurements = [
        measurement(100.0, "alpha", "beta", 5.0),
        measurement(102.0, "beta", "alpha", 7.0),
        measurement(104.0, "alpha", "beta", 30.0),
        measurement(104.0, "alpha", "gamma", None, AoaPath(0.5, 0.1)),
    ]
    account = Account("uwb.csv", rows=5, used=4, notes=["stamps are taken for [s]"])
    account.leave_out("anchor", "line 7")
    reading = RadioReading(WirelessLog(measurements, [Heading(10**11, "alpha", 1.0, 0.1)]), account, "table")
    text = shown(radio_table(reading))
    assert "radio log read as table, from 100.000 s" in text
    assert cells(text, "alpha-beta") == [
        "alpha-beta", "3", "0", "5.0 .. 7.0 .. 30.0", "0.25", "4.0", "2"
    ]  # fmt: skip
    assert cells(text, "alpha-gamma") == [
        "alpha-gamma", "0", "1", "-", "-", "0.0", "-"
    ]  # fmt: skip
    assert "stamps are taken for [s]." in text
    assert "1 of 5 readings are with anchors (first: line 7)." in text
    assert "1 headings." in text


def test_an_empty_log_is_a_table_without_rows() -> None:
    assert "radio log read as table" in shown(radio_table(RadioReading(WirelessLog(), None, "table")))


def test_findings_say_what_to_add() -> None:
    findings = (
        Finding(
            "unit", "suspect", "ranges are [1000] times too long", ("alpha", "beta"), {"unit": "mm", "time_offset": 0.5}
        ),
        Finding("overlap", "good", "all stamps lie within the trajectories"),
    )
    text = shown(check_table(CheckResult(findings)))
    assert "ranges are [1000] times too long" in text
    assert "suspect" in text
    assert "add unit: mm, time_offset: 0.5" in " ".join(text.split())
    assert "unit: mm, time_offset: 0.5" in text
    assert "Add to the source" not in shown(check_table(CheckResult(findings[1:])))


@pytest.mark.parametrize("width", [60, 200])
def test_every_preset_is_listed_whole_at_any_width(width: int) -> None:
    text = shown(presets_table(presets()), width)
    assert all(name[:8] in text for name in presets())
    assert "…" not in text
