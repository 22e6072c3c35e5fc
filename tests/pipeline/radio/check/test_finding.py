from __future__ import annotations

from dataclasses import FrozenInstanceError

import pytest

from wiclosure.pipeline.radio.check.finding import Finding


@pytest.mark.parametrize(
    ("settings", "advice"),
    [
        ({}, ""),
        ({"unit": "mm"}, "add unit: mm"),
        ({"clockwise": True, "azimuth_zero": "left"}, "add clockwise: True, azimuth_zero: left"),
        ({"time_offset": 0}, "add time_offset: 0"),
    ],
)
def test_advice_is_the_settings_as_a_file_has_them(settings, advice):
    assert Finding("unit", "suspect", "text", None, settings).advice == advice


def test_a_finding_is_about_the_log_and_corrects_nothing_unless_it_says_so():
    found = Finding("fit", "good", "it fits")
    assert (found.pair, dict(found.settings)) == (None, {})
    with pytest.raises(FrozenInstanceError):
        found.text = "other"
