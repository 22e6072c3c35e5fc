"""A correction of a reading, laid over that reading, must turn any raw value as both in turn do."""

from __future__ import annotations

import math
from itertools import product

import pytest

from wiclosure.formats.radio.radio_units import azimuth_rad
from wiclosure.pipeline.radio.check.absolute import absolute
from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.source import RadioSource

ZEROS = ("forward", "left", "back", "right")


def source(**settings):
    return RadioSource.model_validate({"path": "log.csv", **settings})


def bearing(**settings):
    return Finding("bearing", "suspect", "turned", ("a", "b"), settings)


@pytest.mark.parametrize(
    ("clockwise", "zero", "turned", "found"),
    [(c, z, t, f) for c, z, t, f in product((False, True), ZEROS, (False, True), ZEROS) if t or f != "forward"],
)
def test_corrections_of_bearings_compose(clockwise, zero, turned, found):
    settings = ({"clockwise": True} if turned else {}) | ({"azimuth_zero": found} if found != "forward" else {})
    stated = source(clockwise=clockwise, azimuth_zero=zero)
    (result,) = absolute([bearing(**settings)], stated)
    both = {"clockwise": clockwise, "azimuth_zero": zero} | dict(result.settings)
    for raw in (-2.0, 0.3, 1.1):
        read = azimuth_rad(raw, "rad", zero, clockwise=clockwise)
        expected = azimuth_rad(read, "rad", found, clockwise=turned)
        written = azimuth_rad(raw, "rad", both["azimuth_zero"], clockwise=both["clockwise"])
        assert math.cos(written - expected) == pytest.approx(1.0)


def test_sense_and_zero_may_stand_in_two_findings_of_a_pair():
    first, second = absolute([bearing(clockwise=True), bearing(azimuth_zero="left")], source(azimuth_zero="left"))
    assert dict(first.settings) == {"clockwise": True}
    assert dict(second.settings) == {"azimuth_zero": "forward"}  # -(raw + 90 deg) + 90 deg


def test_a_shift_of_the_clock_is_added_to_the_stated_one():
    (found,) = absolute([Finding("clock", "suspect", "late", None, {"time_offset": -0.35})], source(time_offset=2.0))
    assert dict(found.settings) == {"time_offset": 1.65}


def test_findings_without_settings_and_other_keys_stay():
    fit, unit = Finding("fit", "good", "fits"), Finding("unit", "suspect", "mm", ("a", "b"), {"unit": "mm"})
    assert absolute([fit, unit], source(time_offset=1.0, clockwise=True)) == [fit, unit]
