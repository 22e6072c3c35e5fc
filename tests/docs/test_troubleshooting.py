"""docs/troubleshooting.md quotes messages that the code does say."""

from __future__ import annotations

import ast
import re

import pytest

from .pages import REPOSITORY, text_of

PACKAGES = ("pipeline", "wiclosure_filter", "frontends", "backends", "src/wiclosure/formats")
PLACES = re.compile(
    r"\b(?:[NMKXYAB]|feet|ahead|alpha|beta|gamma)\b|\bm too\b|\.\.\.|/topic|'x'|\d[\d.]*|\(|\)|%",
)
"""What stands for something else in a quoted message."""


def _said() -> str:
    """All text in the code, with a mark where values are put in."""
    found: list[str] = []
    for package in PACKAGES:
        for path in (REPOSITORY / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.append(node.value)
                elif isinstance(node, ast.JoinedStr):
                    found.append("".join(p.value if isinstance(p, ast.Constant) else "\0" for p in node.values))
    return " ".join(" ".join(found).split())


def _messages() -> list[str]:
    text = text_of(REPOSITORY / "docs" / "troubleshooting.md")
    rows = re.findall(r"^\| (`.*?) \| ", text, re.MULTILINE)
    quoted = re.findall(r"^> (.*)$", text, re.MULTILINE)
    return [message for row in rows for message in re.findall(r"`([^`]+)`", row)] + quoted


@pytest.fixture(scope="module")
def said() -> str:
    return _said()


@pytest.mark.parametrize("message", _messages())
def test_the_message_is_said(message: str, said: str) -> None:
    fixed = [part.strip(" ,:;") for part in PLACES.split(message)]
    fragments = [part for part in fixed if " " in part]
    assert fragments, "nothing to look for"
    for fragment in fragments:
        assert fragment in said
