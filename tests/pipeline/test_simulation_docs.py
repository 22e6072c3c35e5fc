"""What docs/simulation.md names exists; its Python is run by tests/docs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from wiclosure.pipeline.data.scenarios.scenario_source import read_scenario_word, scenario_settings
from wiclosure.simulation import SCENARIOS, RadioSettings, ScenarioSettings, make_scenario

DOCS = Path(__file__).resolve().parents[2] / "docs"
TEXT = (DOCS / "simulation.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("word", sorted(set(re.findall(r'scenario:[\w-]+[^\s`"]*', TEXT)) - {"scenario:NAME"}))
def test_worlds_of_the_examples_can_be_made(word: str) -> None:
    name, settings = read_scenario_word(word)
    assert name in SCENARIOS
    if settings.poses is None:
        make_scenario(name, settings)


def test_every_key_exists() -> None:
    for key in re.findall(r"`(radio\.\w+|lidar_\w+)`", TEXT):
        group, _, name = key.rpartition(".")
        assert name in (RadioSettings if group else ScenarioSettings).model_fields, key
    named = re.search(r"`radio\.` \+ (.*?)\(each", TEXT, re.DOTALL)
    assert named
    for name in re.findall(r"`(\w+)`", named[1]):
        assert name in RadioSettings.model_fields, name
    assert scenario_settings(["radio.heading_sigma_deg=null"], "docs").radio.heading_sigma_deg is None


def test_every_scenario_has_its_picture() -> None:
    for name in SCENARIOS:
        assert f"| `{name}` |" in TEXT
        assert (DOCS / "images" / f"scenario_{name}.png").is_file()
