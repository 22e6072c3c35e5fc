"""Configuration files and presets: what each says, and what it extends.

A file that begins with `extends: NAME` says only what differs from the preset, or from the YAML file, of that name.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, NamedTuple

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.structured_text import parse_yaml, read_yaml
from wiclosure.pipeline.runtime.paths import expanded, is_file
from wiclosure.suggestions import did_you_mean

EXTENDS = "extends"


class Layer(NamedTuple):
    """Settings to be laid over those before them, and where they stand, for messages."""

    place: str
    settings: dict[str, Any]


def preset_names() -> list[str]:
    """Names of the presets that `--config NAME` takes."""
    return sorted(
        p.name.removesuffix(".yaml") for p in files("wiclosure.configs").iterdir() if p.name.endswith(".yaml")
    )


def read_layers(source: str) -> list[Layer]:
    """A file or preset with all that it extends, the furthest first.

    Args:
        source: path of a YAML file, or name of a preset.

    Raises:
        ConfigError: there is no such file or preset, it is no mapping, or it extends itself in the end.
    """
    file = _File.find(source, Path())
    if file is None:
        raise ConfigError(f"configuration {source} not found; {_choices(source)}")
    layers: list[Layer] = []
    while True:
        settings = _mapping(file)
        base = settings.pop(EXTENDS, None)
        layers.insert(0, Layer(file.place, settings))
        if base is None:
            return layers
        file = _extended(file, base)
        if file.place in (places := [layer.place for layer in reversed(layers)]):
            raise ConfigError(f"{' extends '.join([*places, file.place])}: a circle; take one of them out")


@dataclass(frozen=True, slots=True)
class _File:
    """A configuration file or a preset."""

    place: str
    content: Traversable
    folder: Path | None  # where the files lie that it may extend; a preset extends presets only

    @classmethod
    def find(cls, name: str, folder: Path | None) -> _File | None:
        """The file of that name in the folder, or else the preset."""
        if folder is not None and is_file(path := folder / expanded(name)):
            return cls(os.path.normpath(path), path, path.parent)
        preset = files("wiclosure.configs") / f"{name}.yaml"
        return cls(name, preset, None) if "/" not in name and preset.is_file() else None


def _extended(file: _File, name: object) -> _File:
    if not isinstance(name, str) or not name:
        raise ConfigError(f"{file.place}: extends is {name!r}; expected the name of one preset or YAML file")
    base = _File.find(name, file.folder)
    if base is None:
        raise ConfigError(f"{file.place} extends {name}, which is not found; {_choices(name)}")
    return base


def _choices(name: str) -> str:
    known = preset_names()
    return f"{did_you_mean(name, known)}give a YAML file or a preset: {', '.join(known)}"


def _mapping(file: _File) -> dict[str, Any]:
    try:
        content = read_yaml(file.content) if isinstance(file.content, Path) else parse_yaml(file.content.read_text())
    except InputError as error:
        raise ConfigError(str(error)) from error
    if content is None:
        return {}
    if not isinstance(content, dict):
        what = "a list" if isinstance(content, list) else "no keys"
        raise ConfigError(f"{file.place} holds {what}; expected keys and values (see wiclosure dump-config)")
    return content
