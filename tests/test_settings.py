from __future__ import annotations

from typing import Annotated

import pytest
from pydantic import BeforeValidator, Field, ValidationError

from wiclosure.settings import Settings

Name = Annotated[str, BeforeValidator(str)]


class Gate(Settings):
    radius_m: float = Field(5.0, gt=0)
    count: int | None = None
    is_wide: bool = False
    heights_m: list[float] = Field(default_factory=list)
    limits_m: tuple[float | Name, float | Name] | None = None
    arms_m: dict[str, tuple[float, float]] = Field(default_factory=dict)
    flags: list[bool | float] = Field(default_factory=list)


class Wrong(Settings):
    radius_m: float = Field(-1.0, gt=0)


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ({"radius": 3.0}, "Extra inputs are not permitted"),
        ({"radius_m": 0.0}, "greater than 0"),
        ({"radius_m": float("inf")}, "finite number"),
        ({"radius_m": float("nan")}, "finite number|greater than 0"),
        ({"radius_m": "far"}, "valid number"),
        ({"radius_m": True}, "expected a number"),  # what YAML makes of yes
        ({"count": False}, "expected a number"),
        ({"heights_m": [1.0, True]}, "expected a number"),
        ({"limits_m": [0.5, True]}, "expected a number"),
        ({"arms_m": {"a": [0.0, False]}}, "expected a number"),
    ],
)
def test_unknown_keys_and_values_out_of_range_are_errors(given, complaint):
    with pytest.raises(ValidationError, match=complaint):
        Gate(**given)


def test_truth_stays_truth():
    assert Gate(is_wide=True).is_wide
    assert Gate(flags=[True, 2.0]).flags == [True, 2.0]
    assert Gate(heights_m=[1, 2.5], limits_m=["near", 3], arms_m={"a": [1, 2]}).heights_m == [1.0, 2.5]


def test_settings_stay_as_they_are():
    gate = Gate(radius_m=2.0)
    with pytest.raises(ValidationError, match="frozen"):
        gate.radius_m = 3.0
    assert gate == Gate(radius_m=2.0)


def test_defaults_are_checked_too():
    with pytest.raises(ValidationError, match="greater than 0"):
        Wrong()
