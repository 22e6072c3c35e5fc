"""One configuration for a whole run: nested settings from defaults, a YAML file, the environment, the command line.

Later ones win: default < file < environment < command line.  Keys are dotted paths: `keyframes.distance_m` in YAML is
nested, in the environment `WICLOSURE_KEYFRAMES__DISTANCE_M`, on the command line `--set keyframes.distance_m=2`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import yaml
from pydantic import BaseModel, Field, ValidationError

from wiclosure.backends.config import MapSettings, PcmSettings, PoseGraphSettings
from wiclosure.backends.graph_files.settings import GraphFileSettings
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
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.pipeline.presets import Layer, read_layers
from wiclosure.pipeline.runtime.settings_text import explain, merged_settings, nest, nested_words
from wiclosure.settings import Settings
from wiclosure.wiclosure_filter.config import FilterSettings

ENVIRONMENT_PREFIX = "WICLOSURE_"
NOT_SETTINGS = {"WICLOSURE_DATA", "WICLOSURE_CACHE", "WICLOSURE_CACHE_GB"}


class MutualCheckSettings(Settings):
    """Radio against closures that contradict it: which of the two is wrong, by the odds."""

    enabled: bool = Field(True, description="false: what contradicts the radio is rejected, whatever speaks for it")
    systematic_error: float = Field(
        0.05,
        gt=0,
        lt=0.5,
        description="probability that a log has one of the known systematic errors (clock, units, axes, mounting, ids):"
        " of logs that somebody records for the first time, about one in twenty",
    )
    unknown_error: float = Field(
        0.001,
        gt=0,
        lt=0.5,
        description="probability of an error that is none of these and yet fits another alignment, as one reflection"
        " along a whole street does",
    )
    decisive_odds: float = Field(
        10.0, gt=1, description="odds from which one side wins; below, nothing of the pair of robots is accepted"
    )
    budget: int = Field(
        40,
        ge=0,
        description="look-alike pairs of two robots that are registered without prediction where hardly anything agrees"
        " with the predictions: spread over the paths, enough to find a set, seconds to register; 0: none",
    )


class EarthSettings(Settings):
    """What robots measure of the Earth: which way is up, and where on it they are."""

    gravity: bool = Field(True, description="false: inertial measurements are not used")
    gnss: bool = Field(True, description="false: positions of satellite receivers are not used")


class Config(Settings):
    """Everything that can be set about a run."""

    odometry: OdometrySettings = OdometrySettings()
    keyframes: KeyframeSettings = KeyframeSettings()
    drift: DriftModel = DriftModel()
    earth: EarthSettings = EarthSettings()
    scan_context: ScanContextSettings = ScanContextSettings()
    use_filter: str = Field("wiclosure", description="candidate filter: wiclosure, none, range-gate, oracle, random")
    filter: FilterSettings = FilterSettings()
    matching: MatchingSettings = MatchingSettings()
    revisits: IntraRobotLoopSettings = IntraRobotLoopSettings()
    registration: RegistrationSettings = RegistrationSettings()
    mutual_check: MutualCheckSettings = MutualCheckSettings()
    pcm: PcmSettings = PcmSettings()
    pose_graph: PoseGraphSettings = PoseGraphSettings()
    graphs: GraphFileSettings = GraphFileSettings()
    map: MapSettings = MapSettings()
    evaluation: EvaluationSettings = EvaluationSettings()


def load_config(
    *sources: str,
    environment: Mapping[str, str] | None = None,
    overrides: Sequence[str] = (),
) -> Config:
    """The configuration from all its places.

    Args:
        sources: paths of YAML files, or names of presets, each laid over those before it, after what it extends.
        environment: usually `os.environ`.
        overrides: `key.path=value` words, values in YAML.

    Raises:
        ConfigError: names the key, the value and the place it came from, and suggests the near key.
    """
    layers = [layer for source in sources for layer in read_layers(source)]
    layers.append(Layer("the environment", _from_environment(environment or {})))
    layers.append(Layer("--set", nested_words(overrides, "--set")))
    merged: dict[str, Any] = {}
    for place, layer in layers:
        merged = merged_settings(merged, layer)
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


def dump_config(config: BaseModel, *, comments: bool = True) -> str:
    """The configuration as YAML, each key with its meaning as a comment."""
    return "\n".join(_yaml_lines(config, indent="", comments=comments)) + "\n"


def _from_environment(environment: Mapping[str, str]) -> dict[str, Any]:
    """`WICLOSURE_A__B=value` as nested keys; a misspelt variable is an error like any other unknown key."""
    nested: dict[str, Any] = {}
    for name in sorted(environment):
        if name.startswith(ENVIRONMENT_PREFIX) and name not in NOT_SETTINGS:
            keys = name.removeprefix(ENVIRONMENT_PREFIX).lower().split("__")
            nested = merged_settings(nested, nest(keys, environment[name]))
    return nested


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
