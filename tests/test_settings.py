from __future__ import annotations

import pytest
from pydantic import Field, ValidationError

from wiclosure.settings import Settings


class Gate(Settings):
    radius_m: float = Field(5.0, gt=0)
    count: int | None = None
    is_wide: bool = False


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
    ],
)
def test_unknown_keys_and_values_out_of_range_are_errors(given, complaint):
    with pytest.raises(ValidationError, match=complaint):
        Gate(**given)


def test_truth_stays_truth():
    assert Gate(is_wide=True).is_wide


def test_settings_stay_as_they_are():
    gate = Gate(radius_m=2.0)
    with pytest.raises(ValidationError, match="frozen"):
        gate.radius_m = 3.0
    assert gate == Gate(radius_m=2.0)


def test_defaults_are_checked_too():
    with pytest.raises(ValidationError, match="greater than 0"):
        Wrong()
