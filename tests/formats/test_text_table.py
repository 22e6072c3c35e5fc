"""Tables of text: delimiters, headers, encodings, and mutated files."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.formats.text_cells import SPACE
from wiclosure.formats.text_table import open_table


@pytest.mark.parametrize(
    ("text", "columns", "delimiter", "first"),
    [
        ("t,d\n1,2\n", ("t", "d"), ",", ["1", "2"]),
        ("t;d\n1,5;2,25\n", ("t", "d"), ";", ["1,5", "2,25"]),
        ("t\td\n1\t2\n", ("t", "d"), "\t", ["1", "2"]),
        ("t   d\n1   2\n", ("t", "d"), SPACE, ["1", "2"]),
        ("1 2 alpha\n2 3 beta\n", ("1", "2", "3"), SPACE, ["1", "2", "alpha"]),
        ("# t d\n1 2\n", ("t", "d"), SPACE, ["1", "2"]),
        ("# a remark of many words\n1 2\n", ("1", "2"), SPACE, ["1", "2"]),
        ("\ufefft,d\n\n# later\n1,2\n", ("t", "d"), ",", ["1", "2"]),
        ('t,"d, of b"\n1,2\n', ("t", "d, of b"), ",", ["1", "2"]),
        ("t,1_1\n1,2\n", ("t", "1_1"), ",", ["1", "2"]),
        ("t,d\n1,2,,,\n3,4,,,\n", ("t", "d"), ",", ["1", "2"]),  # cells that a spreadsheet left empty
    ],
)
def test_kinds_of_tables(tmp_path: Path, text: str, columns: tuple[str, ...], delimiter: str, first: list[str]) -> None:
    (tmp_path / "a").write_text(text, encoding="utf-8")
    table = open_table(tmp_path / "a")
    assert (table.columns, table.delimiter) == (columns, delimiter)
    assert next(table.rows())[1] == first


def test_sixteen_bits_a_letter(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("t,d\n1,2\n", encoding="utf-16")
    assert [cells for _, cells in open_table(tmp_path / "a").rows()] == [["1", "2"]]


def test_degrees_as_windows_writes_them_and_a_bad_byte(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes("t;Winkel [°]\n1;20\n".encode("cp1252"))
    assert open_table(tmp_path / "a").columns == ("t", "Winkel [°]")
    (tmp_path / "a").write_bytes(b"t,d\n" + b"1,2\n" * 30_000 + b"\xff,2\n")
    assert [cells for _, cells in open_table(tmp_path / "a").rows()][-1] == ["\ufffd", "2"]


def test_names_for_a_table_without_any(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("1 2\n3 4\n")
    table = open_table(tmp_path / "a", names=["t", "d"])
    assert [line for line, _ in table.rows()] == [1, 2]


@pytest.mark.parametrize("content", [b"", b"\n\n# nothing\n", b"\x89PNG\r\n\x1a\n\xff\x00"])
def test_what_is_no_table(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a").write_bytes(content)
    with pytest.raises(InputError, match=str(tmp_path)):
        list(open_table(tmp_path / "a").rows())


def test_mutated_tables_are_read_or_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    whole = bytearray(b"time,tag,anchor,range\n" + b"".join(b"%d.5,7,12,%d.25\n" % (i, i % 9) for i in range(40)))
    for number in range(200):
        content = bytearray(whole)
        for _ in range(rng.integers(1, 6)):
            content[rng.integers(len(content))] = rng.integers(256)
        content = content[: rng.integers(1, len(content) + 1)] if number % 3 == 0 else content
        (tmp_path / "a.csv").write_bytes(content)
        try:
            assert all(isinstance(cells, list) for _, cells in open_table(tmp_path / "a.csv").rows())
        except InputError as error:
            assert str(tmp_path) in str(error)  # noqa: PT017


def test_a_cell_of_any_length_spoils_its_row_only(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("time,from,to,range\n1.1,7,12,2.5\n1.2,7,12," + "9" * 500_000 + "\n1.3,7,12,2.6\n")
    rows = [cells for _, cells in open_table(file).rows()]
    assert [cells[3] for cells in (rows[0], rows[2])] == ["2.5", "2.6"]
    assert float(rows[1][3]) > 1e90


def test_a_spreadsheet_is_to_be_saved_as_text(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "uwb.xlsx", "w") as sheet:
        sheet.writestr("xl/workbook.xml", "<workbook/>")
    with pytest.raises(InputError, match=r"uwb\.xlsx is not a table of text .*; save it as CSV"):
        open_table(tmp_path / "uwb.xlsx")
