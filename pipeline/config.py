"""One configuration for a whole run: nested settings from defaults, a YAML file, the environment, the command line.

Later ones win: default < file < environment < command line.  Keys are dotted paths: `keyframes.distance_m` in YAML is
nested, in the environment `WICLOSURE_KEYFRAMES__DISTANCE_M`, on the command line `--set keyframes.distance_m=2`.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, Field, ValidationError

from wiclosure.backends.config import MapSettings, PcmSettings, PoseGraphSettings
from wiclosure.drift import DriftModel
from wiclosure.errors import ConfigError
from wiclosure.frontends.config import (
    IntraRobotLoopSettings,
    KeyframeSettings,
    MatchingSettings,
    OdometrySettings,
    RegistrationSettings,
    ScanContextSettings,
)
from wiclosure.pipeline.evaluation.evaluate import EvaluationSettings
from wiclosure.settings import Settings
from wiclosure.wiclosure_filter.config import FilterSettings

ENVIRONMENT_PREFIX = "WICLOSURE_"
NOT_SETTINGS = {"WICLOSURE_DATA", "WICLOSURE_CACHE", "WICLOSURE_CACHE_GB"}


class Config(Settings):
    """Everything that can be set about a run."""

    odometry: OdometrySettings = OdometrySettings()
    keyframes: KeyframeSettings = KeyframeSettings()
    drift: DriftModel = DriftModel()
    scan_context: ScanContextSettings = ScanContextSettings()
    use_filter: str = Field("wiclosure", description="candidate filter: wiclosure, none, range-gate, oracle, random")
    filter: FilterSettings = FilterSettings()
    matching: MatchingSettings = MatchingSettings()
    revisits: IntraRobotLoopSettings = IntraRobotLoopSettings()
    registration: RegistrationSettings = RegistrationSettings()
    pcm: PcmSettings = PcmSettings()
    pose_graph: PoseGraphSettings = PoseGraphSettings()
    map: MapSettings = MapSettings()
    evaluation: EvaluationSettings = EvaluationSettings()


def load_config(
    *sources: str,
    environment: Mapping[str, str] | None = None,
    overrides: Sequence[str] = (),
) -> Config:
    """The configuration from all its places.

    Args:
        sources: paths of YAML files, or names of presets in `wiclosure.configs`, each laid over those before it.
        environment: usually `os.environ`.
        overrides: `key.path=value` words, values in YAML.

    Raises:
        ConfigError: names the key, the value and the place it came from, and suggests the near key.
    """
    layers = [_read_file(source) for source in sources]
    layers.append(("the environment", _from_environment(environment or {})))
    layers.append(("--set", nested_words(overrides, "--set")))
    merged: dict[str, Any] = {}
    for place, layer in layers:
        merged = _merge(merged, layer)
        # Validated layer by layer, so that an error names the place that brought it.
        try:
            config = Config.model_validate(merged)
        except ValidationError as error:
            raise ConfigError(explain(error, place, Config)) from None
    return config


def resolve(
    source: str | None,
    overrides: Sequence[str] | None,
    *,
    preset: str | None = None,
    seed: int | None = None,
    use_filter: str | None = None,
) -> Config:
    """The configuration of a command: its file, a preset on top, this process's environment, and its options.

    Raises:
        ConfigError: see `load_config`.
    """
    words = list(overrides or ())
    if seed is not None:
        words.append(f"filter.random.seed={seed}")
    if use_filter is not None:
        words.append(f"use_filter={use_filter}")
    sources = [name for name in (source, preset) if name is not None]
    return load_config(*sources, environment=os.environ, overrides=words)


def preset_names() -> list[str]:
    """Names of the presets that `--config NAME` takes."""
    return sorted(
        p.name.removesuffix(".yaml") for p in files("wiclosure.configs").iterdir() if p.name.endswith(".yaml")
    )


def dump_config(config: BaseModel, *, comments: bool = True) -> str:
    """The configuration as YAML, each key with its meaning as a comment."""
    return "\n".join(_yaml_lines(config, indent="", comments=comments)) + "\n"


def _read_file(source: str) -> tuple[str, dict[str, Any]]:
    path = Path(source)
    preset = files("wiclosure.configs") / f"{source}.yaml"
    if path.is_file():
        text = path.read_text(encoding="utf-8", errors="replace")
    elif "/" not in source and preset.is_file():
        text = preset.read_text(encoding="utf-8")
    else:
        known = preset_names()
        near = difflib.get_close_matches(source, known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]}? Give" if near else "give"
        raise ConfigError(f"configuration {source} not found; {hint} a YAML file or a preset: {', '.join(known)}")
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ConfigError(f"{source} is not valid YAML: {' '.join(str(error).split())}") from None
    if content is None:
        content = {}
    if not isinstance(content, dict):
        raise ConfigError(
            f"{source} holds a {type(content).__name__}; expected keys and values (see wiclosure dump-config)"
        )
    return source, content


def _from_environment(environment: Mapping[str, str]) -> dict[str, Any]:
    """`WICLOSURE_A__B=value` as nested keys; a misspelt variable is an error like any other unknown key."""
    nested: dict[str, Any] = {}
    for name in sorted(environment):
        if name.startswith(ENVIRONMENT_PREFIX) and name not in NOT_SETTINGS:
            keys = name.removeprefix(ENVIRONMENT_PREFIX).lower().split("__")
            nested = _merge(nested, _nest(keys, environment[name]))
    return nested


def nested_words(words: Sequence[str], place: str) -> dict[str, Any]:
    """`key.path=value` words, values in YAML, as nested keys; `place` is where they stand, for messages.

    Raises:
        ConfigError: a word of another form.
    """
    nested: dict[str, Any] = {}
    for word in words:
        path, equals, value = word.partition("=")
        if not equals or not path:
            raise ConfigError(f"{place} {word}: expected key.path=value")
        nested = _merge(nested, _nest(path.split("."), value))
    return nested


def _nest(keys: list[str], value: str) -> dict[str, Any]:
    try:
        nested: Any = yaml.safe_load(value)
    except yaml.YAMLError:
        nested = value
    for key in reversed(keys):
        nested = {key: nested}
    assert isinstance(nested, dict)
    return nested


def _merge(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    """`above` laid over `below`, group by group."""
    merged = dict(below)
    for key, value in above.items():
        inner = merged.get(key)
        merged[key] = _merge(inner, value) if isinstance(inner, dict) and isinstance(value, dict) else value
    return merged


def explain(error: ValidationError, place: str, model: type[BaseModel]) -> str:
    """The first problem with the settings of that model as one sentence; unknown keys with a near one."""
    problem = error.errors()[0]
    location = [str(part) for part in problem["loc"]]
    key = ".".join(location)
    if problem["type"] == "extra_forbidden":
        known = _keys_at(model, location[:-1])
        near = difflib.get_close_matches(location[-1], known, n=1, cutoff=0.5)
        hint = f"did you mean {'.'.join([*location[:-1], near[0]])}?" if near else f"known here: {', '.join(known)}"
        return f"unknown configuration key {key} in {place}; {hint}"
    message = problem["msg"].removeprefix("Value error, ")
    return f"configuration {key} = {problem['input']!r} in {place}: {message[0].lower()}{message[1:]}"


def _keys_at(model: type[BaseModel], path: list[str]) -> list[str]:
    """Known keys of the group at `path`."""
    for part in path:
        annotation = model.model_fields[part].annotation if part in model.model_fields else None
        if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
            return []
        model = annotation
    return list(model.model_fields)


def _yaml_lines(model: BaseModel, indent: str, *, comments: bool) -> list[str]:
    lines: list[str] = []
    for name, field in type(model).model_fields.items():
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            if comments and isinstance(type(value).__doc__, str):
                lines.append(f"{indent}# {str(type(value).__doc__).splitlines()[0]}")
            lines.append(f"{indent}{name}:")
            lines.extend(_yaml_lines(value, indent + "  ", comments=comments))
            continue
        plain = model.model_dump(mode="json", include={name})[name]
        text = yaml.safe_dump(plain, default_flow_style=True, width=10_000).removesuffix("...\n").rstrip()
        note = f"  # {field.description}" if comments and field.description else ""
        lines.append(f"{indent}{name}: {text}{note}")
    return lines
