"""Tables for notebooks: plain HTML, in the notebook's own letters and colours."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

_CELL = "text-align:left;vertical-align:top"


def html_table(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """A table of two columns, what and how much, under a title; all of it is text and may hold any character."""
    lines = "".join(
        f'<tr><th scope="row" style="{_CELL}">{escape(name)}</th><td style="{_CELL}">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f'<table><caption style="{_CELL};font-weight:bold">{escape(title)}</caption><tbody>{lines}</tbody></table>'
