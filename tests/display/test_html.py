from __future__ import annotations

from xml.etree import ElementTree as ET

from wiclosure.display import html_table


def test_all_of_it_is_text() -> None:
    table = ET.fromstring(html_table("a <b> & c", [("x < y", '"quoted" & <script>')]))
    assert [element.text for element in table.iter() if element.text] == ["a <b> & c", "x < y", '"quoted" & <script>']
