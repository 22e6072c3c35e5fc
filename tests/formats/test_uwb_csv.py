"""UWB ranges from CSV: real recordings, any column names, bad input."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.formats.uwb_csv import RangeColumn, UwbColumns, read_uwb_csv

PLAIN = UwbColumns(stamp="time", ranges=(RangeColumn("d", "s"),))


def write(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "uwb.csv"
    file.write_text(text)
    return file


def test_real_ranges_are_near_the_truth(data_dir: Path) -> None:
    file = data_dir / "uwb_ranges" / "08" / "08_base-1_targ-2_win-1_step-1.csv"
    pairs = tuple(RangeColumn(f"{i}_{j}", f"{i}_{j}_std") for i in (1, 2) for j in (1, 2))
    log = read_uwb_csv(file, UwbColumns(ranges=pairs), receiver="r1", transmitter="r2")
    with file.open() as table:
        true = [float(row[f"{c.range}_t"]) for row in csv.DictReader(table) for c in pairs]
    assert len(log.measurements) == len(true)
    error = np.array([m.range_m for m in log.measurements], float) - true
    assert 0 < np.median(error) < 0.3  # UWB ranges too long rather than too short


def test_any_columns_units_and_robots(tmp_path: Path) -> None:
    file = write(tmp_path, "\ufeffms,who,whom,d\n1700000000123.456789,a,b,3.5\n1700000000200,b,c,\n")
    columns = UwbColumns("ms", (RangeColumn("d", None, (0, 0, 1)),), "ms", "who", "whom", sigma_m=0.3)
    (measurement,) = read_uwb_csv(file, columns).measurements
    assert measurement.stamp_ns == 1700000000123456789
    assert (measurement.receiver, measurement.transmitter) == ("a", "b")
    assert (measurement.range_m, measurement.range_sigma_m) == (3.5, 0.3)
    assert measurement.lever_arm_receiver == (0, 0, 1)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("t,d,s\n1,2,3\n", "no column 'time'"),
        ("time,d,s\n1,x,3\n", "line 2: d is 'x'"),
        ("time,d,s\n1,2,3\nx,2,3\n", "line 3: time is 'x'"),
        ("time,d,s\n1,-2,3\n", "line 2: range is -2"),
        ("time,d,s\n1,2,-3\n", "line 2: range_sigma"),
        ("time,d,s\n1e99999999,2,3\n", "line 2: time"),
        ("time,d,s\nNaN,2,3\n", "line 2: time"),
        ("time,d,s\n1\n", None),
        ("", "no column"),
    ],
)
def test_bad_tables_are_one_sentence_with_file_and_line(tmp_path: Path, text: str, says: str | None) -> None:
    file = write(tmp_path, text)
    if says is None:
        assert read_uwb_csv(file, PLAIN, receiver="a", transmitter="b").measurements == ()
        return
    with pytest.raises(InputError) as caught:
        read_uwb_csv(file, PLAIN, receiver="a", transmitter="b")
    assert str(file) in str(caught.value)
    assert says in str(caught.value)


def test_robots_must_be_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no receiver"):
        read_uwb_csv(write(tmp_path, "time,d,s\n1,2,3\n"), PLAIN)
    with pytest.raises(InputError, match="unit"):
        read_uwb_csv(write(tmp_path, ""), UwbColumns(stamp_unit="h"))
