from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wiclosure.pipeline.stages.radio_readings import AS_CLAIMED, FAULTS, FEET_PER_M, OTHERWISE_READ, Reading
from wiclosure.types import AoaPath, Heading, WirelessLog, WirelessMeasurement

Spoil = Callable[[WirelessMeasurement], WirelessMeasurement]

BEARING = WirelessMeasurement(
    1_000_000_000, "a", "b", 12.0, 0.3, (AoaPath(0.4, 0.1), AoaPath(-2.0, 0.1)), transmitter_stamp_ns=1_000_000_000
)
RANGE = WirelessMeasurement(2_000_000_000, "b", "a", 7.0, 0.3, transmitter_stamp_ns=2_000_000_000)
LOG = WirelessLog((BEARING, RANGE), (Heading(0, "a", 0.1, 0.05),))


def turned(change: Callable[[float], float]) -> Spoil:
    return lambda m: replace(m, paths=tuple(replace(p, azimuth=change(p.azimuth)) for p in m.paths))


def late(m: WirelessMeasurement) -> WirelessMeasurement:
    """The clock of b is 0.75 s ahead."""
    if m.receiver == "a":
        return replace(m, transmitter_stamp_ns=m.stamp_ns - 750_000_000)
    return replace(m, stamp_ns=m.stamp_ns - 750_000_000)


def in_feet(m: WirelessMeasurement) -> WirelessMeasurement:
    assert m.range_m is not None
    assert m.range_sigma_m is not None
    return replace(m, range_m=FEET_PER_M * m.range_m, range_sigma_m=FEET_PER_M * m.range_sigma_m)


def too_long(m: WirelessMeasurement) -> WirelessMeasurement:
    assert m.range_m is not None
    return replace(m, range_m=m.range_m + 3.0)


@pytest.mark.parametrize(
    ("spoil", "kind", "cause"),
    [
        (in_feet, "units of ranges", "its ranges are in feet"),
        (too_long, "bias of ranges", "its ranges are about 3 m too long"),
        (late, "clock", "the robots' clocks are about 0.75 s apart"),
        (turned(lambda a: -a), "handedness of azimuths", "its azimuths run clockwise, from x forward"),
        (turned(lambda a: a - np.pi / 2), "zero of azimuths", "its azimuths are counted from y left"),
        (turned(lambda a: a + np.pi), "zero of azimuths", "its azimuths are counted from x backward"),
        (
            turned(lambda a: a + np.radians(20)),
            "mounting of the antennas",
            "its azimuths are turned by about 20 degrees",
        ),
    ],
)
def test_one_correction_undoes_each_error(spoil: Spoil, kind: str, cause: str) -> None:
    spoilt = replace(LOG, measurements=tuple(map(spoil, LOG.measurements)))
    reading = named(kind)
    undone = dict(zip(reading.causes, reading.corrections, strict=True))[cause](spoilt)
    for found, right in zip(undone.measurements, LOG.measurements, strict=True):
        assert (found.stamp_ns, found.transmitter_stamp_ns) == (right.stamp_ns, right.transmitter_stamp_ns)
        assert found.range_m == pytest.approx(right.range_m)
        assert found.range_sigma_m == pytest.approx(right.range_sigma_m)
        assert [p.azimuth for p in found.paths] == pytest.approx([p.azimuth for p in right.paths])


def named(kind: str) -> Reading:
    return next(reading for reading in FAULTS if reading.kind == kind)


def test_every_cause_has_its_correction_and_none_leaves_such_a_log_as_it_is() -> None:
    assert AS_CLAIMED.corrections[0](LOG) == LOG
    for reading in FAULTS:
        assert len(reading.causes) == len(reading.corrections)
        changed = [correction(LOG) != LOG for correction in reading.corrections]
        assert all(changed) or reading.kind == "axes of azimuths"  # which is in body axes already
    assert {reading.kind for reading in OTHERWISE_READ} < {reading.kind for reading in FAULTS}


def test_parts_of_a_log_that_may_be_wrong_are_left_out() -> None:
    (ranged, other) = named("directions").corrections[0](LOG).measurements
    assert (ranged.range_m, ranged.paths, other) == (12.0, (), RANGE)
    (directed,) = named("ranges").corrections[0](LOG).measurements
    assert (directed.range_m, directed.paths) == (None, BEARING.paths)
    assert named("compass").corrections[0](LOG).headings == ()


def test_what_changes_no_range_leaves_a_log_without_directions_as_it_is() -> None:
    log = WirelessLog((RANGE,))
    for kind in ("handedness of azimuths", "zero of azimuths", "mounting of the antennas", "axes of azimuths", "ids"):
        assert all(correction(log) == log for correction in named(kind).corrections)
