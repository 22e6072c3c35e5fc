"""Tables as loggers and spreadsheets write them: the same forty ranges in each."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.radio.read import read_radio
from wiclosure.pipeline.radio.words import sources_of_words

STAMPS = 1_700_000_000 + 0.5 * np.arange(40)
RANGES = 10 + 3 * np.sin(np.arange(40) / 5)
NAMES = "timestamp,from_id,to_id,range\n"


def rows(row: Callable[[float, float], str]) -> str:
    return "".join(f"{row(stamp, reading)}\n" for stamp, reading in zip(STAMPS, RANGES, strict=True))


def row(stamp: float, reading: float) -> str:
    return f"{stamp:.3f},7,12,{reading:.4f}"


def ticks(per_s: int) -> str:
    return rows(lambda stamp, reading: f"{round(stamp * per_s)},7,12,{reading:.4f}")


def tagged(a: str, b: str) -> str:
    return rows(lambda stamp, reading: f"{stamp:.3f},{a},{b},{reading:.4f}")


def dated(stamp: float, reading: float) -> str:
    return f"{datetime.fromtimestamp(stamp, UTC):%Y-%m-%d,%H:%M:%S.%f},7,12,{reading:.4f}"


def halves(stamp: float, reading: float) -> str:
    return f"{int(stamp)},{round(stamp % 1 * 1e9)},7,12,{reading:.4f}"


PLAIN = NAMES + rows(row)
VARIANTS = {
    "remarks of percent": "% logger v3\n% begun\n" + PLAIN,
    "remarks of slashes": "// logger v3\n" + PLAIN,
    "remarks of semicolons": "; logger v3\n" + PLAIN,
    "words before the table": "UWB log\nFirmware,1.2\n\n" + PLAIN,
    "many remarks": "# remark\n" * 80 + PLAIN,
    "names in a remark": "# " + PLAIN,
    "names and units in remarks": "# " + NAMES + "# [s],-,-,[m]\n" + rows(row),
    "line of units": NAMES + "s,-,-,m\n" + rows(row),
    "line of other units": NAMES + "ms,-,-,mm\n" + rows(lambda t, r: f"{t * 1e3:.0f},7,12,{r * 1e3:.1f}"),
    "rows end in a comma": NAMES + rows(lambda t, r: row(t, r) + ","),
    "bars": PLAIN.replace(",", "|"),
    "single quotes": NAMES.replace(",", "','").replace("timestamp", "'timestamp").replace("range", "range'")
    + rows(row),
    "camel case": "timeStamp,fromId,toId,rangeMeters\n" + rows(row),
    "words with spaces": "Time Stamp (s),From ID,To ID,Range (m)\n" + rows(row),
    "inches": "timestamp,from_id,to_id,range_in\n" + rows(lambda t, r: f"{t},7,12,{r / 0.0254}"),
    "unit in the cell": NAMES + rows(lambda t, r: row(t, r) + " m"),
    "other unit in the cell": NAMES + rows(lambda t, r: f"{t},7,12,{r * 1e3:.1f}mm"),
    "ticks of 100 us": NAMES + ticks(10**4),
    "ticks of 10 us": NAMES + ticks(10**5),
    "ticks of 100 ns": NAMES + ticks(10**7),
    "seconds and nanoseconds": "sec,nsec,from_id,to_id,range\n" + rows(halves),
    "stamps of ROS": "header.stamp.sec,header.stamp.nanosec,from_id,to_id,range\n" + rows(halves),
    "date and time": "date,time,from_id,to_id,range\n" + rows(dated),
    "objects of JSON": rows(lambda t, r: f'{{"t": {t}, "from": 7, "to": 12, "range": {r:.4f}, "more": null}}'),
    "nested objects": rows(lambda t, r: f'{{"header": {{"stamp": {t}}}, "src": 7, "dst": 12, "range": {r:.4f}}}'),
}


def read(folder: Path, content: str | bytes, settings: str = "robots.7=alpha,robots.12=beta") -> tuple[list, list]:
    path = folder / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    (source,) = sources_of_words([f"{path},{settings}"])
    found = read_radio(source, ("alpha", "beta")).log.measurements
    return [m.stamp_ns for m in found], [m.range_m for m in found]


def assert_read(found: tuple[list, list]) -> None:
    np.testing.assert_allclose(np.array(found[0]) * 1e-9, STAMPS, atol=1e-3)
    np.testing.assert_allclose(found[1], RANGES, atol=1e-3)


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_same_ranges_are_read(tmp_path: Path, variant: str) -> None:
    assert_read(read(tmp_path, VARIANTS[variant]))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig", "cp1252"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    assert_read(read(tmp_path, PLAIN.encode(encoding)))


def test_columns_that_are_called_by_numbers(tmp_path: Path) -> None:
    numbered = "0,1,2,3\n" + rows(row)
    assert_read(read(tmp_path, numbered, "stamp=0,from=1,to=2,range=3,robots.7=alpha,robots.12=beta"))
    with pytest.raises(InputError, match=r"no column of times is known; name it with stamp: .*its columns: 0, 1, 2, 3"):
        read(tmp_path, numbered)


def test_addresses_in_any_spelling(tmp_path: Path) -> None:
    for a, b in (("DE:CA:00:07", "de:ca:00:12"), ("DE-CA-00-07", "DE-CA-00-12"), ("deca0007", "DECA0012")):
        found = read(tmp_path, NAMES + tagged(a, b), "robots.de:ca:00:07=alpha,robots.de:ca:00:12=beta")
        assert_read(found)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (NAMES + rows(lambda t, r: f"{t},7,12,{r * 100:.1f}"), "beyond 1000 m .* add unit: mm or unit: cm"),
        (NAMES + rows(lambda t, r: f"22:13:20.5,7,12,{r}"), r"a time of day; name the column of the date too"),
        (NAMES + rows(lambda t, r: f"14.11.2023 22:13:20,7,12,{r}"), "write dates as 2024-05-31T14:05:00.25"),
        (PLAIN.replace(",", ":"), "say what stands between the cells by delimiter:"),
        ("timestamp,tag,d_12,d_13\n" + rows(lambda t, r: f"{t},7,{r},5"), r"together as range: 'd_\{to\}'"),
        ("timestamp,7_12,7_13\n" + rows(lambda t, r: f"{t},{r},5"), r"together as range: '\{from\}_\{to\}'"),
        ('[{"t": 1.5, "from": 7}]', "write one object a line"),
    ],
)
def test_what_is_refused_names_the_way_out(tmp_path: Path, content: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        read(tmp_path, content)


def test_ranges_that_no_radio_reaches_are_doubted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read(tmp_path, NAMES + rows(lambda t, r: f"{t},7,12,{r * 50:.1f}"))
    assert "if they are centimetres add unit: cm" in caplog.text
    caplog.clear()
    read(tmp_path, NAMES + rows(lambda t, r: f"{t},7,12,{r * 50:.1f}"), "unit=m,robots.7=alpha,robots.12=beta")
    assert "centimetres" not in caplog.text


def test_a_table_without_rows_is_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert read(tmp_path, NAMES) == ([], [])
    assert "it holds no readings" in caplog.text


def test_ranges_below_a_metre_are_doubted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read(
        tmp_path,
        "timestamp;from_id;to_id;range\n1;7;12;20.534\n2;7;12;19.222\n",
        "unit=mm,robots.7=alpha,robots.12=beta",
    )
    assert "all ranges are 0.021 m or shorter; check the unit (mm)" in caplog.text
