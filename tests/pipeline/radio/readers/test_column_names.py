from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.radio.readers.column_names import guess, guessed_fields
from wiclosure.pipeline.radio.source import RadioSource

LOG = Path("uwb.csv")


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (
            ["time_ms", "tag", "anchor", "distance_mm"],
            {"stamp": "time_ms", "stamp_unit": "ms", "from": "tag", "to": "anchor", "range": "distance_mm",
             "unit": "mm"},
        ),
        (
            ["Timestamp [ns]", "Range (m)", "Sigma", "src", "dst"],
            {"stamp": "Timestamp [ns]", "stamp_unit": "ns", "range": "Range (m)", "unit": "m", "range_sigma": "Sigma",
             "from": "src", "to": "dst"},
        ),
        (["t", "azimuth deg"], {"stamp": "t", "azimuth": "azimuth deg", "angle_unit": "deg"}),
        (["Host Time", "dist meters"], {"stamp": "Host Time", "range": "dist meters", "unit": "m"}),
        (["temperature", "rssi"], {}),
    ],
)  # fmt: skip
def test_names_and_units_of_loggers(columns: list[str], expected: dict[str, str]) -> None:
    assert guess(columns) == expected


def test_what_the_source_states_is_not_guessed() -> None:
    source = RadioSource.model_validate({"path": LOG, "unit": "cm", "receiver": "alpha"})
    found = guessed_fields(["time", "tag", "anchor", "distance_mm"], source, LOG, has_header=True)
    assert (found.unit, found.receiver, found.from_, found.to) == ("cm", "alpha", None, "anchor")
    assert (found.stamp, found.range_) == (("time",), ("distance_mm",))
    named = RadioSource.model_validate({"path": LOG, "range": "uwb"})
    found = guessed_fields(["time", "uwb", "azimuth", "distance"], named, LOG, has_header=True)
    assert (found.range_, found.azimuth) == (("uwb",), None)  # what is measured is named, so nothing else is taken


@pytest.mark.parametrize(
    ("columns", "settings", "says"),
    [
        (["when", "distance"], {}, r"no column of times is known; name it with stamp: .* its columns: when, distance"),
        (["time", "size"], {}, r"no column of ranges is known; name it with range:, or azimuth:; its columns"),
        (["time", "distance"], {"has_header": False}, "no column of times"),
    ],
)
def test_what_is_missing_is_said_with_the_columns(columns: list[str], settings: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        guessed_fields(columns, RadioSource(path=LOG), LOG, has_header=settings.get("has_header", True))
