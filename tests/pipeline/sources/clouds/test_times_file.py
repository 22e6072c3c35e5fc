from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.times_file import read_lines, read_times, times_beside


def test_seconds_nanoseconds_and_dates_to_the_nanosecond(tmp_path: Path) -> None:
    path = tmp_path / "times.txt"
    path.write_text("# time\n1700000000.000000001\n\n1700000000123456789\n2011-09-26 13:02:25.594360375\n1.5e1\n\n\n")
    assert read_lines(path) == [
        1_700_000_000_000_000_001, None, 1_700_000_000_123_456_789, 1_317_042_145_594_360_375, 15 * 10**9
    ]  # fmt: skip
    assert read_times(path).tolist() == [stamp for stamp in read_lines(path) if stamp is not None]


@pytest.mark.parametrize("line", ["now", "1.2.3", "2011-13-40 99:00:00"])
def test_a_line_that_is_no_time_is_named(tmp_path: Path, line: str) -> None:
    (tmp_path / "times.txt").write_text(f"1.0\n{line}\n")
    with pytest.raises(InputError, match=r"times\.txt, line 2: .* is no time; expected seconds or a date with time"):
        read_times(tmp_path / "times.txt")


@pytest.mark.parametrize("between", [" ", ",", "; ", "\t"])
def test_numbers_of_the_scans_before_the_times(tmp_path: Path, between: str) -> None:
    path = tmp_path / "times.txt"
    path.write_text("".join(f"{number:06d}{between}{10 + 0.1 * number:.1f}\n" for number in range(7, 12)) + "\n")
    assert read_lines(path) == [10_000_000_000 + number * 100_000_000 for number in range(7, 12)]
    path.write_text("7 10.0\n9 10.2\n")  # no scan's number
    with pytest.raises(InputError, match=r"line 1: '7 10\.0' is no time"):
        read_lines(path)


def test_files_that_are_missing_or_no_text(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read .*a KITTI folder needs it"):
        read_times(tmp_path / "times.txt")
    (tmp_path / "times.txt").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(InputError, match="is not text"):
        read_times(tmp_path / "times.txt")


def test_times_of_a_folder_lie_in_it_or_beside_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path / "velodyne"
    folder.mkdir()
    assert times_beside(folder, 2) is None
    (tmp_path / "times.txt").write_text("1\n2\n")
    stamps_ns, path = times_beside(folder, 2)
    assert (stamps_ns.tolist(), path) == ([10**9, 2 * 10**9], tmp_path / "times.txt")
    (folder / "timestamps.txt").write_text("3\n4\n")
    assert times_beside(folder, 2)[1] == folder / "timestamps.txt"
    assert times_beside(folder, 3) is None
    assert "timestamps.txt has 2 times for the 3 clouds" in caplog.text


def test_a_file_beside_the_folder_may_be_of_something_else_but_not_one_in_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = tmp_path / "velodyne"
    folder.mkdir()
    (tmp_path / "times.txt").write_text("calibration\n")
    assert times_beside(folder, 1) is None
    assert "it is not used for the clouds in" in caplog.text
    (folder / "times.txt").write_text("calibration\n")
    with pytest.raises(InputError, match="is no time"):
        times_beside(folder, 1)


@pytest.mark.parametrize(("step", "unit"), [(200_000_000, "ns"), (100_000, "us"), (100, "ms")])
def test_times_since_a_start_up_in_other_units_are_told_by_their_steps(
    tmp_path: Path, step: int, unit: str, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "times.txt").write_text("".join(f"{n * step}\n" for n in range(5)))
    period_ns = step * {"ns": 1, "us": 10**3, "ms": 10**6}[unit]
    assert read_times(tmp_path / "times.txt").tolist() == [n * period_ns for n in range(5)]
    assert f"read as {unit}" in caplog.text


@pytest.mark.parametrize("times", ["3\n2\n1\n0\n", "0.0\n0.0\n0.0\n"])
def test_times_that_mostly_repeat_or_go_back_are_refused(tmp_path: Path, times: str) -> None:
    (tmp_path / "times.txt").write_text(times)
    with pytest.raises(InputError, match=r"times\.txt, line 2: .* does not follow the time above it"):
        read_times(tmp_path / "times.txt")


def test_two_clouds_of_each_time_are_read(tmp_path: Path) -> None:
    (tmp_path / "times.txt").write_text("0.0\n0.0\n0.1\n0.1\n")
    assert len(read_times(tmp_path / "times.txt")) == 4


@pytest.mark.parametrize(
    ("head", "rows"),
    [
        ("timestamp", ["1.0", "1.1"]),
        ("# made by a recorder\ntimestamp [s]", ["1.0", "1.1"]),
        ("#timestamp [us]", ["1000000", "1100000"]),
        ("time_ms", ["1000", "1100"]),
    ],
)
def test_a_line_of_names_and_remarks_are_no_scans_and_may_state_the_unit(
    tmp_path: Path, head: str, rows: list[str]
) -> None:
    path = tmp_path / "times.txt"
    path.write_text("\n".join([head, *rows, "", "# the rest was lost", rows[-1] + "9"]) + "\n")
    first, second, blank, _ = read_lines(path)
    assert (first, second, blank) == (10**9, 1_100_000_000, None)
