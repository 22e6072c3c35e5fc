"""Presets are valid settings, and each says where it comes from."""

from __future__ import annotations

from importlib.resources import files

import pytest

from wiclosure.pipeline.radio.presets import preset_of_header, preset_of_message, presets
from wiclosure.pipeline.radio.source import RadioSource


@pytest.mark.parametrize("name", sorted(presets()))
def test_a_preset_is_valid_and_names_its_source(name: str) -> None:
    RadioSource.model_validate({"topic": "/any", **presets()[name].settings})
    text = (files("wiclosure.configs") / "radio" / f"{name}.yaml").read_text(encoding="utf-8")
    assert text.startswith("# ")
    assert "github.com/" in text or "_msgs" in text or "Decawave" in text


def test_messages_have_one_preset_each() -> None:
    types = [message for preset in presets().values() for message in preset.messages]
    assert len(types) == len(set(types))
    found = preset_of_message("sensor_msgs/msg/Range")
    assert found is not None
    assert found.name == "sensor-range"
    assert preset_of_message("sensor_msgs/msg/Imu") is None
    assert preset_of_header(("t", "d")) is None
