from __future__ import annotations

import json
import math
from html.parser import HTMLParser
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.errors import InputError, OutputError
from wiclosure.pipeline.report.html.page import embedded, read_page, write_page

NASTY = [
    "</script><script>alert(1)</script>",
    "<!-- <script>",
    "quotes \" ' ` and \\ backslash",
    "line\nbreak\r\ttab\u2028\u2029",
    "Ünïcödé 机器人 🤖",
    "{data} & &amp; ]]>",
]


class Scripts(HTMLParser):
    """What stands in the scripts of a page, as a browser tells them apart."""

    def __init__(self) -> None:
        super().__init__()
        self.contents: list[str] = []
        self.inside = False

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag == "script":
            self.inside = True
            self.contents.append("")

    def handle_endtag(self, tag: str) -> None:
        self.inside = self.inside and tag != "script"

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.contents[-1] += data


@pytest.mark.parametrize("text", NASTY)
def test_no_text_breaks_the_page(text: str, tmp_path: Path) -> None:
    report = {"title": text, "runs": [{"name": text, "reasons": {text: [text]}}]}
    write_page(tmp_path / "report.html", report)
    assert read_page(tmp_path / "report.html") == report
    found = Scripts()
    found.feed((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert len(found.contents) == 2  # the data and the program, and no third
    assert json.loads(found.contents[0])["title"] == text


@given(st.text())
def test_any_text_is_embedded_without_an_angle_bracket(text: str) -> None:
    assert "<" not in embedded({"text": text})
    assert json.loads(embedded({text: text})) == {text: text}


def test_what_is_no_number_becomes_null() -> None:
    assert json.loads(embedded({"values": [math.nan, math.inf, -math.inf, 1.5], "nested": ({"n": math.nan},)})) == {
        "values": [None, None, None, 1.5],
        "nested": [{"n": None}],
    }


def test_pages_of_others_are_refused_in_a_line(tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    for content in ("<html></html>", '<script type="application/json" id="report-data">{"a": 1</script>', ""):
        page.write_text(content)
        with pytest.raises(InputError, match="holds no report of wiclosure"):
            read_page(page)
    page.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="it is no text"):
        read_page(page)
    with pytest.raises(InputError, match="No such file"):
        read_page(tmp_path / "none.html")


def test_a_folder_that_cannot_be_written_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        write_page(tmp_path / "nowhere" / "report.html", {"title": "", "runs": []})
