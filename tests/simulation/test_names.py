from __future__ import annotations

import pytest

from wiclosure.errors import ConfigError
from wiclosure.simulation.names import lookup

TABLE = {"hdl64": 64, "vlp16": 16}


def test_a_name_is_looked_up() -> None:
    assert lookup("LiDAR", "vlp16", TABLE) == 16


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("VLP-16", "unknown LiDAR 'VLP-16': did you mean vlp16? known are hdl64, vlp16"),
        ("kinect", "unknown LiDAR 'kinect': known are hdl64, vlp16"),
    ],
)
def test_an_unknown_one_is_answered_with_the_nearest_and_all(name: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        lookup("LiDAR", name, TABLE)
    assert str(caught.value) == message
