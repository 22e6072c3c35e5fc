from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from wiclosure.pipeline.radio.source import RadioSource, keys


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({}, "needs a path, or a topic"),
        ({"path": "a.csv", "x": "px"}, "x and y go together"),
        ({"path": "a.csv", "stamp": ["a", "b", "c"]}, "one field, or two of seconds and nanoseconds"),
        ({"path": "a.csv", "unit": "yards"}, "unit"),
        ({"path": "a.csv", "rnage": "d"}, "Extra inputs"),
        ({"path": "a.csv", "robots": "by name"}, "by number"),
    ],
)
def test_what_does_not_go_together_is_refused(settings: dict, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        RadioSource.model_validate(settings)


def test_keys_are_those_of_files_and_ids_may_be_numbers() -> None:
    source = RadioSource.model_validate({"path": "a.csv", "from": 2, "range": ["d1", 5], "robots": {7: "alpha"}})
    assert (source.from_, source.range_, source.robots) == ("2", ("d1", "5"), {"7": "alpha"})
    assert {"from", "range", "robots", "azimuth_zero"} <= set(keys())
    assert not {"from_", "range_"} & set(keys())


@pytest.mark.parametrize(
    ("settings", "receiver"),
    [
        ({"topic": "/uwb/range"}, "alpha"),
        ({"topic": "/uwb/{to}"}, "alpha"),
        ({"topic": "/uwb/{from}/{to}"}, None),
        ({"topic": "/uwb", "from": "tag"}, None),
        ({"topic": "/uwb", "receiver": "gamma"}, "gamma"),
    ],
)
def test_in_a_robots_own_bag_it_measured_unless_something_says_who_did(settings: dict, receiver: str | None) -> None:
    source = RadioSource.model_validate(settings).of_bag(Path("alpha.bag"), "alpha")
    assert (source.path, source.receiver) == (Path("alpha.bag"), receiver)
    assert source.described() == f"alpha.bag {settings['topic']}"
