from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from wiclosure.errors import ConfigError
from wiclosure.pipeline.config import Config, dump_config, load_config
from wiclosure.pipeline.presets import preset_names


def test_defaults() -> None:
    assert load_config() == Config()


def test_later_places_win(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("keyframes: {distance_m: 2.0, rotation_rad: 0.3}\nmap: {voxel_size_m: 0.1}\n")
    environment = {"WICLOSURE_KEYFRAMES__DISTANCE_M": "3.0", "WICLOSURE_MAP__VOXEL_SIZE_M": "0.2", "PATH": "/bin"}
    config = load_config(str(file), environment=environment, overrides=["map.voxel_size_m=0.3"])
    assert (config.keyframes.rotation_rad, config.keyframes.distance_m, config.map.voxel_size_m) == (0.3, 3.0, 0.3)


def test_dump_reads_back(tmp_path: Path) -> None:
    config = load_config(overrides=["keyframes.distance_m=2.5", "filter.gate.budget=100", "use_filter=none"])
    (tmp_path / "config.yaml").write_text(dump_config(config))
    assert load_config(str(tmp_path / "config.yaml")) == config


def test_dump_explains_every_key() -> None:
    text = dump_config(Config())
    for line in text.splitlines():
        key, _, value = line.partition(":")
        if value.strip() and not key.strip().startswith("#"):
            assert "#" in line, f"{line} has no explanation"


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_valid(name: str) -> None:
    assert isinstance(load_config(name), Config)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["keyframes.distanse_m=2"], r"unknown .* keyframes\.distanse_m in --set; did you mean keyframes\.distance_m"),
        (["keyframe.distance_m=2"], r"did you mean keyframes\?"),
        (["pcm.rival_share=0.8"], r"did you mean pcm\.ambiguous_share\?"),
        (["keyframes.distance_m=-2"], r"keyframes\.distance_m = -2 in --set: input should be greater than 0"),
        (["keyframes.distance_m=far"], r"keyframes\.distance_m = 'far'"),
        (["keyframes.distance_m=.nan"], r"keyframes\.distance_m = nan"),
        (["keyframes"], r"expected key\.path=value"),
        (["pcm.metric=euclid"], r"pcm\.metric = 'euclid'.*mahalanobis"),
        (["keyframes=3"], r"configuration keyframes = 3"),
    ],
)  # fmt: skip
def test_bad_values_are_one_sentence(overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        load_config(overrides=overrides)
    assert "\n" not in str(caught.value)


def test_misspelt_environment_variable() -> None:
    with pytest.raises(ConfigError, match=r"unknown configuration key keyframes\.distance in the environment"):
        load_config(environment={"WICLOSURE_KEYFRAMES__DISTANCE": "2"})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a: [1", "bad.yaml, line"),
        ("- 1", "holds a list"),
        ("pcm: {speed: 3}", r"unknown configuration key pcm\.speed"),
    ],
)
def test_bad_files(tmp_path: Path, content: str, message: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(content)
    with pytest.raises(ConfigError, match=message) as caught:
        load_config(str(file))
    assert str(file) in str(caught.value)


def test_missing_file_lists_presets(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="strong"):
        load_config(str(tmp_path / "none.yaml"))
    with pytest.raises(ConfigError, match="strong"):
        load_config("no-such-preset")


def test_empty_file_is_the_defaults(tmp_path: Path) -> None:
    (tmp_path / "empty.yaml").write_text("")
    assert load_config(str(tmp_path / "empty.yaml")) == Config()


def test_dump_is_valid_yaml_without_comments_too() -> None:
    assert yaml.safe_load(dump_config(Config(), comments=False)) == yaml.safe_load(dump_config(Config()))
