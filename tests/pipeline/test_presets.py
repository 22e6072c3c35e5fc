"""Configuration files that say only what differs from others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.config import load_config
from wiclosure.pipeline.presets import Layer, preset_names, read_layers

Write = Callable[[str, str], str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a file, and gives its path."""

    def write(name: str, content: str) -> str:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(content)
        return str(path)

    return write


def test_a_file_says_only_what_differs_from_a_preset(write: Write) -> None:
    mine = write("mine.yaml", "extends: disco-kitti\npcm: {unit_threshold: 7.0}\n")
    base, config = load_config("disco-kitti"), load_config(mine)
    assert config.pcm == base.pcm.model_copy(update={"unit_threshold": 7.0})
    assert config.model_copy(update={"pcm": base.pcm}) == base


def test_the_furthest_base_comes_first_and_paths_are_relative_to_the_file(write: Write) -> None:
    write("site/hall.yaml", "map: {voxel_size_m: 0.1}\n")
    middle = write("robots.yaml", "extends: site/hall.yaml\nmap: {voxel_size_m: 0.2}\n")
    top = write("site/mine.yaml", "extends: ../robots.yaml\n")
    assert [layer.settings for layer in read_layers(top)] == [
        {"map": {"voxel_size_m": 0.1}}, {"map": {"voxel_size_m": 0.2}}, {}
    ]  # fmt: skip
    assert read_layers(middle)[-1] == Layer(middle, {"map": {"voxel_size_m": 0.2}})


def test_a_file_may_extend_the_preset_of_its_own_name(write: Write) -> None:
    assert load_config(write("disco-park.yaml", "extends: disco-park\n")) == load_config("disco-park")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("extends: disco-prak", r"mine\.yaml extends disco-prak, which is not found; did you mean disco-park\?"),
        ("extends: other.yaml", r"mine\.yaml extends other\.yaml, which is not found; give a YAML file or a preset"),
        ("extends: [strong]", r"mine\.yaml: extends is \['strong'\]; expected the name of one"),
        ("extends: mine.yaml", r"mine\.yaml extends .*mine\.yaml: a circle"),
        ("extends: ../folder/mine.yaml", r"mine\.yaml extends .*mine\.yaml: a circle"),
        ("extends: two.yaml", r"mine\.yaml extends .*two\.yaml extends .*mine\.yaml: a circle; take one"),
        ("extends: bad.yaml", r"bad\.yaml holds a list"),
        ("extends: wrong.yaml", r"unknown configuration key pcm\.speed in .*wrong\.yaml"),
    ],
)
def test_what_cannot_be_extended_is_one_line(write: Write, content: str, message: str) -> None:
    write("folder/two.yaml", "extends: mine.yaml")
    write("folder/bad.yaml", "- 1")
    write("folder/wrong.yaml", "pcm: {speed: 3}")
    with pytest.raises(ConfigError, match=message) as caught:
        load_config(write("folder/mine.yaml", content))
    assert "\n" not in str(caught.value)


def test_extends_is_none_of_the_settings() -> None:
    with pytest.raises(ConfigError, match="unknown configuration key extends in --set"):
        load_config(overrides=["extends=strong"])


@pytest.mark.parametrize("name", [name for name in preset_names() if len(read_layers(name)) > 1])
def test_a_preset_repeats_nothing_of_what_it_extends(name: str) -> None:
    *_, base, own = read_layers(name)
    below = load_config(base.place).model_dump(mode="json")
    for group, values in own.settings.items():
        for key, value in values.items():
            assert below[group][key] != value, f"{name}: {group}.{key}"
