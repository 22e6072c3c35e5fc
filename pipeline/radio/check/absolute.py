"""Corrections as keys of the source, whatever it states already: what was found is relative to how the log was read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import replace

from wiclosure.formats.radio.radio_units import AzimuthZero
from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.source import RadioSource

_QUARTERS: Mapping[AzimuthZero, int] = {"forward": 0, "left": 1, "back": 2, "right": 3}


def absolute(findings: Sequence[Finding], source: RadioSource) -> list[Finding]:
    """The findings of one pair, their settings laid over those of the source.

    The source reads `s raw + z`; a correction of that, `s' (s raw + z) + z'`, is the sense `s' s` and the zero
    `s' z + z'`.
    """
    stated = {key for finding in findings for key in finding.settings}
    return [replace(finding, settings=_settings(finding, source, stated)) for finding in findings]


def _settings(finding: Finding, source: RadioSource, stated: Set[str]) -> dict[str, object]:
    """The keys of one finding; `stated` are those of all findings of the pair, relative."""
    settings = dict(finding.settings)
    if isinstance(shift_s := settings.get("time_offset"), int | float):
        settings["time_offset"] = round(source.time_offset + shift_s, 3)
    if "clockwise" in settings:
        settings["clockwise"] = not source.clockwise
    quarter = _QUARTERS[source.azimuth_zero] * (-1 if "clockwise" in stated else 1)
    found = next((number for zero, number in _QUARTERS.items() if settings.get("azimuth_zero") == zero), None)
    if found is not None:
        settings["azimuth_zero"] = _zero(quarter + found)
    elif "clockwise" in settings and "azimuth_zero" not in stated and _zero(quarter) != source.azimuth_zero:
        settings["azimuth_zero"] = _zero(quarter)  # the other sense turns the stated zero to the other side
    return settings


def _zero(quarter: int) -> AzimuthZero:
    return next(zero for zero, number in _QUARTERS.items() if quarter % 4 == number)
