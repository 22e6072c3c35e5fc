"""Links lead somewhere, every page is found, and commands with their options exist."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer.main

from wiclosure.pipeline.cli.commands import app

from .pages import DOCS, PAGES, REPOSITORY, text_of


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_lead_somewhere(page: Path) -> None:
    text = text_of(page)
    targets = [target.partition("#") for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]
    missing = [target for target, _, _ in targets if not (page.parent / target).exists()]
    assert missing == []
    for target, _, heading in targets:
        if heading:
            other = text if not target else text_of(page.parent / target)
            assert heading in _anchors(other), f"{target}#{heading}"


def _anchors(text: str) -> set[str]:
    """What a forge makes of the headings."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_index_has_every_page() -> None:
    index = text_of(REPOSITORY / "docs" / "index.md")
    pages = {page.stem for page in DOCS} - {"index"} | {"tutorial"}
    assert pages == {target.partition(".")[0] for target in re.findall(r"\]\(([\w.]+)\)", index)}
    trees = "\n".join(re.findall(r"```\{toctree\}(.*?)```", index, re.DOTALL))
    assert sorted(re.findall(r"^\w+$", trees, re.MULTILINE)) == sorted(pages)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_and_their_options_exist(page: Path) -> None:
    text = text_of(page).replace("\\\n", " ")
    blocks = "\n".join(re.findall(r"^```[^\n]*\n(.*?)^```$", text, re.DOTALL | re.MULTILINE))
    in_lines = re.findall(r"`(wiclosure [^`]*)`", text)
    for line in [*re.findall(r"^(?:\$ )?(wiclosure .*)$", blocks, re.MULTILINE), *in_lines]:
        if "[OPTIONS]" in line:  # a pattern, no command
            continue
        _check(shlex.split(line, comments=True)[1:], typer.main.get_command(app), line)


def _check(words: list[str], command: Any, line: str) -> None:
    while words and not words[0].startswith("-") and hasattr(command, "commands"):
        assert words[0] in command.commands, line
        command, words = command.commands[words[0]], words[1:]
    known = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    options = [word.partition("=")[0] for word in words if re.match(r"--?[a-zA-Z]", word)]
    assert set(options) <= known | {"--help"}, line


def test_every_package_has_its_place_in_the_house() -> None:
    house = text_of(REPOSITORY / "docs" / "house.md")
    packages = tomllib.loads(text_of(REPOSITORY / "pyproject.toml"))["tool"]["setuptools"]["packages"]
    folders = {name.split(".")[min(2, name.count("."))] for name in packages} - {"wiclosure"}
    assert {folder for folder in folders if f"{folder}/" not in house} == set()


def test_the_readme_is_short() -> None:
    assert len(text_of(REPOSITORY / "README.md").splitlines()) <= 150


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_of_code_that_a_page_names_exist(page: Path) -> None:
    rooms = [REPOSITORY, *(REPOSITORY / room for room in ("wiclosure_filter", "pipeline", "backends", "frontends"))]
    named = set(re.findall(r"(?<![\w./-])([a-z_]+/[\w/]+\.py)\b", text_of(page)))
    assert [name for name in sorted(named) if not any((room / name).exists() for room in rooms)] == []
