"""docs/radio.md: its examples are read, its commands run, its table of presets is complete."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
import yaml

from wiclosure.pipeline import cli
from wiclosure.pipeline.radio.presets import presets
from wiclosure.pipeline.radio.source import RadioSource

PAGE = Path(__file__).resolve().parents[3] / "docs" / "radio.md"
BLOCK = re.compile(r"```(\w+)(?: (\S+))?\n(.*?)```", re.DOTALL)


@pytest.fixture
def page() -> str:
    if not PAGE.is_file():
        pytest.skip("docs are not part of an installed package")
    return PAGE.read_text(encoding="utf-8")


def test_the_examples_do_what_the_page_says(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    commands = 0
    for language, name, text in BLOCK.findall(page):
        if name:
            Path(name).write_text(text, encoding="utf-8")
        elif language == "console":
            for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
                command, *expected = part.strip().splitlines()
                run(command, monkeypatch)
                printed = " ".join(capsys.readouterr().out.split())
                for line in expected:
                    assert " ".join(line.split()) in printed, command
                commands += 1
    assert commands >= 7


def run(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import shlex

    monkeypatch.setattr(sys, "argv", shlex.split(command))
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 0, command


def test_the_sources_of_the_page_are_valid(page: str) -> None:
    found = [text for language, name, text in BLOCK.findall(page) if language == "yaml" and not name]
    sources = [entry for text in found for entry in yaml.safe_load(text)["wireless"]]
    assert len([RadioSource.model_validate(entry) for entry in sources]) == 4


def test_every_preset_is_in_the_table(page: str) -> None:
    rows = re.findall(r"^\| `([\w-]+)` \| (.*?) \|", page, re.MULTILINE)
    assert dict(rows) == {preset.name: preset.about for preset in presets().values()}
