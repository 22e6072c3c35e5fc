"""docs/radio.md: its sources are valid, its table of presets is complete; tests/docs runs its examples."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from wiclosure.pipeline.radio.presets import presets
from wiclosure.pipeline.radio.source import RadioSource

PAGE = Path(__file__).resolve().parents[3] / "docs" / "radio.md"
BLOCK = re.compile(r"```(\w+)(?: (\S+))?\n(.*?)```", re.DOTALL)


@pytest.fixture
def page() -> str:
    if not PAGE.is_file():
        pytest.skip("docs are not part of an installed package")
    return PAGE.read_text(encoding="utf-8")


def test_the_sources_of_the_page_are_valid(page: str) -> None:
    found = [text for language, name, text in BLOCK.findall(page) if language == "yaml" and not name]
    sources = [entry for text in found for entry in yaml.safe_load(text)["wireless"]]
    assert len([RadioSource.model_validate(entry) for entry in sources]) == 5


def test_every_preset_is_in_the_table(page: str) -> None:
    rows = re.findall(r"^\| `([\w-]+)` \| (.*?) \|", page, re.MULTILINE)
    assert dict(rows) == {preset.name: preset.about for preset in presets().values()}
