"""What the code says of settings, commands and names stands in the pages."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable

import pytest

import wiclosure
from wiclosure import errors
from wiclosure.pipeline.config import Config, load_config

from .pages import REPOSITORY, text_of

DOCS = REPOSITORY / "docs"


@pytest.fixture(scope="module")
def page() -> Callable[[str], str]:
    found: Callable[[str], str] = runpy.run_path(str(DOCS / "reference.py"))["page"]
    return found


@pytest.mark.parametrize("name", ["settings.md", "commands.md"])
def test_the_page_is_what_the_code_says(name: str, page: Callable[[str], str]) -> None:
    assert text_of(DOCS / name) == page(name), "write it anew: python docs/reference.py"


def rows() -> list[str]:
    """The settings of the page, each with its section."""
    found, section = [], ""
    for line in text_of(DOCS / "settings.md").splitlines():
        if heading := re.fullmatch(r"#+ `([\w.]+)`", line):
            section = f"{heading[1]}."
        elif row := re.match(r"\| `(\w+)` \| `", line):
            found.append(f"{section}{row[1]}")
    return found


def test_every_setting_has_its_row() -> None:
    def leaves(settings: dict[str, object], path: str = "") -> set[str]:
        below = [leaves(v, f"{path}{k}.") if isinstance(v, dict) else {f"{path}{k}"} for k, v in settings.items()]
        return set().union(*below)

    assert set(rows()) == leaves(Config().model_dump())
    assert len(rows()) == len(set(rows()))


def test_settings_and_presets_that_pages_name_exist() -> None:
    """`--set key=value` and `--config name` as they stand in code, on every page."""
    for page in (*DOCS.glob("*.md"), REPOSITORY / "README.md"):
        code = "\n".join(re.findall(r"`([^`]+)`", text_of(page)))
        for word in re.findall(r"--set ([a-z_.]+=[\w.:-]+)", code):
            load_config(overrides=[word])
        for preset in re.findall(r"--config ([a-z][\w-]+)(?![\w.-])", code):
            load_config(preset)


def test_settings_that_pages_speak_of_exist() -> None:
    """`section.key`, alone or with a value, wherever it stands in code."""
    known = set(rows())
    known |= {".".join(name.split(".")[:depth]) for name in known for depth in (1, 2, 3)}
    tops = "|".join(Config.model_fields)
    for page in (*DOCS.glob("*.md"), REPOSITORY / "README.md"):
        for name in re.findall(rf"`((?:{tops})\.[a-z_.]+[a-z])(?:[:=][^`]*)?`", text_of(page)):
            assert name in known or name.endswith((".ply", ".pcd", ".png", ".py")), f"{page.name}: {name}"


def test_every_public_name_is_in_the_api() -> None:
    text = text_of(DOCS / "api.md")
    listed = set(re.findall(r":: wiclosure\.(\w+)$", text, re.MULTILINE)) | set(vars(errors))
    assert set(wiclosure.__all__) <= listed
