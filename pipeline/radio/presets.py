"""Presets of radio logs: settings of common data sets and drivers, as YAML in `wiclosure.configs.radio`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from wiclosure.errors import InputError
from wiclosure.formats.structured_text import parse_yaml, read_yaml
from wiclosure.pipeline.runtime.paths import expanded, is_file
from wiclosure.suggestions import did_you_mean


@dataclass(frozen=True)
class Preset:
    """What is known of a data set or driver.

    Args:
        name: its file's name.
        about: one line for people.
        settings: keys of `RadioSource`.
        messages: message types that it is for; it is then taken for them without being named.
        header: names of columns that a table of it has.
    """

    name: str
    about: str
    settings: Mapping[str, Any]
    messages: tuple[str, ...] = ()
    header: tuple[str, ...] = ()


@cache
def presets() -> Mapping[str, Preset]:
    """All presets by name."""
    folder = files("wiclosure.configs") / "radio"
    found = (file for file in folder.iterdir() if file.name.endswith(".yaml"))
    named = {file.name.removesuffix(".yaml"): parse_yaml(file.read_text(encoding="utf-8")) for file in found}
    return {name: _preset(name, named[name]) for name in sorted(named)}


def preset_settings(name: str, folder: Path) -> Mapping[str, Any]:
    """The settings of a preset, or of a YAML file (relative to the folder).

    Raises:
        InputError: there is no such preset or file.
    """
    if name in presets():
        return presets()[name].settings
    file = folder / expanded(name)
    if is_file(file):
        content = read_yaml(file)
        if isinstance(content, dict):
            return content
        raise InputError(f"{file} holds no settings; expected keys and values of one wireless source")
    hint = did_you_mean(name, presets())
    raise InputError(f"radio preset {name!r} not found; {hint}known: {', '.join(presets())}, or a YAML file")


def preset_of_message(msgtype: str) -> Preset | None:
    """The preset for messages of a type, in ROS 2 notation."""
    return next((preset for preset in presets().values() if msgtype in preset.messages), None)


def preset_of_header(columns: tuple[str, ...]) -> Preset | None:
    """The preset whose tables have all those columns."""
    fitting = [preset for preset in presets().values() if preset.header and set(preset.header) <= set(columns)]
    return max(fitting, key=lambda preset: len(preset.header), default=None)


def _preset(name: str, content: Mapping[str, Any]) -> Preset:
    return Preset(
        name,
        content["about"],
        content["settings"],
        tuple(content.get("messages", ())),
        tuple(content.get("header", ())),
    )
