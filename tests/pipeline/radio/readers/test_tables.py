from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.pipeline.radio.readers.tables import line_rows, opened, table_rows
from wiclosure.pipeline.radio.source import RadioSource


def source(path: Path, **settings: object) -> RadioSource:
    return RadioSource.model_validate({"path": path, **settings})


@pytest.fixture
def write(tmp_path: Path):
    def write(text: str, **settings: object) -> tuple[Path, RadioSource]:
        path = tmp_path / "uwb.csv"
        path.write_text(text)
        return path, source(path, **settings)

    return write


def rows(path: Path, of: RadioSource) -> list[tuple[str, dict, str | None]]:
    return [(row.place, dict(row.values), row.problem) for row in table_rows(opened(path, of), of)[0]]


def test_a_row_a_line_by_the_names_of_columns(write) -> None:
    found = rows(*write("time,tag,anchor,distance,note\n1.5,7,12,3.25,x\n2.5,7,12,3.5,y\n"))
    assert found == [
        ("line 2", {"stamp": "1.5", "from": "7", "to": "12", "range": "3.25"}, None),
        ("line 3", {"stamp": "2.5", "from": "7", "to": "12", "range": "3.5"}, None),
    ]


def test_a_family_of_columns_is_a_measurement_each_with_the_ids_of_its_name(write) -> None:
    text = "time;d_1_2;d_1_3;s_1_2;s_1_3\n1,5;4,5;6,5;0,1;0,2\n"
    settings = {"range": "d_{from}_{to}", "range_sigma": "s_{from}_{to}", "stamp": "time"}
    assert [values for _, values, _ in rows(*write(text, **settings))] == [
        {"from": "1", "to": "2", "range": "4.5", "range_sigma": "0.1", "stamp": "1.5"},
        {"from": "1", "to": "3", "range": "6.5", "range_sigma": "0.2", "stamp": "1.5"},
    ]


def test_two_columns_of_time_and_limits_in_columns_or_numbers(write) -> None:
    settings = {"stamp": ["sec", "nsec"], "range": "d", "range_limits": ["low", 50.0]}
    ((_, values, _),) = rows(*write("sec,nsec,low,d\n7,25,0.5,9\n", **settings))
    assert values == {"range_high": 50.0, "range_low": "0.5", "range": "9", "stamp": ("7", "25")}


def test_columns_by_number_and_lines_of_other_lengths(write) -> None:
    text = "1.0 7 12 3.5\n2.0 7 12\n3.0 7 12 4.5 9 9\n4.0 8 12 5.5\n"
    settings = {"stamp": 1, "from": 2, "to": 3, "range": 4}
    found = rows(*write(text, **settings))
    assert [(place, problem) for place, _, problem in found] == [
        ("line 1", None),
        ("line 2", "3 cells, expected 4"),
        ("line 3", "6 cells, expected 4"),
        ("line 4", None),
    ]


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"range": "dist"}, r"uwb\.csv has no column 'dist'; its columns: time, d \(or their numbers, 1 to 2\)"),
        ({"range": 3}, "has no column '3'"),
        ({"range": "d_{to}"}, "has no column 'd_{to}'"),
    ],
)
def test_a_column_that_is_not_there_is_named_with_those_that_are(write, settings: dict, says: str) -> None:
    with pytest.raises(InputError, match=says):
        rows(*write("time,d\n1,2\n", **settings))


def test_a_delimiter_is_one_character(write) -> None:
    with pytest.raises(ConfigError, match="delimiter is '::'; expected one character, space, tab, comma or semicolon"):
        rows(*write("time,d\n1,2\n", delimiter="::"))


PATTERN = r"(?P<to>\w\d)=(?P<range>[\d.]+)"


def test_every_place_of_a_line_where_the_pattern_fits(write) -> None:
    path, of = write("# log\n\n10.5 a1=3.25 b2=4\n11.5 nothing\n", pattern=PATTERN)
    assert [(row.place, dict(row.values), row.problem) for row in line_rows(path, of)] == [
        ("line 3", {"stamp": "10.5", "to": "a1", "range": "3.25"}, None),
        ("line 3", {"stamp": "10.5", "to": "b2", "range": "4"}, None),
        ("line 4", {}, "the pattern fits nowhere"),
    ]


def test_what_lines_cannot_be_read_by(write, tmp_path: Path) -> None:
    path, without = write("1 2\n")
    with pytest.raises(ConfigError, match="lines need a pattern"):
        line_rows(path, without)
    with pytest.raises(ConfigError, match=r"pattern '\(' is no regular expression"):
        line_rows(path, source(path, pattern="("))
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"uwb\.csv is no text"):
        list(line_rows(path, source(path, pattern=PATTERN)))
    with pytest.raises(InputError, match=r"cannot read .*none: No such file"):
        list(line_rows(tmp_path / "none", source(path, pattern=PATTERN)))


def test_marks_between_thousands_are_taken_out_of_numbers_and_not_of_ids(write) -> None:
    text = "time_ms;tag;anchor;distance_mm\n1'500;1'007;12;20,534\n1'700;1'007;12;950\n"
    ranges = [(values["stamp"], values["from"], values["range"]) for _, values, _ in rows(*write(text))]
    assert ranges == [("1500", "1'007", "20534"), ("1700", "1'007", "950")]
