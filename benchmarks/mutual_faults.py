"""Systematic errors of a wireless log, made on purpose: `FAULTS`, which the filter looks for, and `BEYOND`, others."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from wiclosure.types import AoaFrame, AoaPath, Heading, WirelessLog, WirelessMeasurement

FEET = 3.28084


Fault = Callable[[WirelessLog], WirelessLog]


def each(change: Callable[[WirelessMeasurement], WirelessMeasurement]) -> Fault:
    """Measurements changed one by one."""
    return lambda log: replace(log, measurements=tuple(change(m) for m in log.measurements))


def azimuths(change: Callable[[float], float]) -> Fault:
    """Directions of arrival changed."""

    def changed(path: AoaPath) -> AoaPath:
        return replace(path, azimuth=float(np.remainder(change(path.azimuth) + np.pi, 2 * np.pi) - np.pi))

    return each(lambda m: replace(m, paths=tuple(map(changed, m.paths))))


def ranges(change: Callable[[float], float], sigma: float = 1.0) -> Fault:
    """Ranges changed."""
    return each(
        lambda m: (
            m
            if m.range_m is None or m.range_sigma_m is None
            else replace(m, range_m=abs(change(m.range_m)), range_sigma_m=sigma * m.range_sigma_m)
        )
    )


def clocks(seconds: float) -> Fault:
    """The clock of the later robot of each pair is ahead, as its own log would have it: its pose is looked up late."""
    late_ns = round(seconds * 1e9)

    def shifted(m: WirelessMeasurement) -> WirelessMeasurement:
        sent_ns = m.stamp_ns if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns
        if m.receiver < m.transmitter:
            return replace(m, transmitter_stamp_ns=sent_ns + late_ns)
        return replace(m, stamp_ns=m.stamp_ns + late_ns, transmitter_stamp_ns=sent_ns)

    return each(shifted)


def claimed(frame: AoaFrame) -> Fault:
    """The wrong `aoa_frame`."""
    return each(lambda m: replace(m, aoa_frame=frame))


def compass(degrees: float) -> Fault:
    """The compass of the robot that is last by name is turned."""

    def spoil(log: WirelessLog) -> WirelessLog:
        last, off = max(log.robots()), np.radians(degrees)

        def turned(h: Heading) -> Heading:
            return replace(h, heading=float(h.heading + off)) if h.robot == last else h

        return replace(log, headings=tuple(map(turned, log.headings)))

    return spoil


FAULTS: Mapping[str, Fault] = {
    "honest": lambda log: log,
    "clocks 0.5 s": clocks(0.5),
    "clocks 2 s": clocks(2.0),
    "azimuth clockwise": azimuths(lambda a: -a),
    "azimuth from the left": azimuths(lambda a: a - np.pi / 2),
    "azimuth reversed": azimuths(lambda a: a + np.pi),
    "azimuth +20 deg": azimuths(lambda a: a + np.radians(20)),
    "azimuth in degrees": azimuths(np.degrees),
    "ranges in feet": ranges(lambda r: FEET * r, FEET),
    "ranges +3 m": ranges(lambda r: r + 3.0),
    "sigmas a tenth": ranges(lambda r: r, 0.1),
    "aoa_frame odometry": claimed("odometry"),
    "ids swapped": each(lambda m: replace(m, receiver=m.transmitter, transmitter=m.receiver)),
    "compass +20 deg": compass(20.0),
    "compass +180 deg": compass(180.0),
}


# Faults that nothing was written for --------------------------------------------------------------------------------


def each_path(change: Callable[[AoaPath], AoaPath]) -> Fault:
    """Paths changed one by one."""
    return each(lambda m: replace(m, paths=tuple(map(change, m.paths))))


def some(share: float, fault: Fault) -> Fault:
    """A fault that a share of the measurements has, drawn at random."""

    def spoil(log: WirelessLog) -> WirelessLog:
        drawn = np.random.default_rng(0).random(len(log.measurements)) < share
        spoilt = fault(log).measurements
        mixed = (s if d else m for m, s, d in zip(log.measurements, spoilt, drawn, strict=True))
        return replace(log, measurements=tuple(mixed))

    return spoil


def of_receiver(fault: Fault) -> Fault:
    """A fault of what the robot that is last by name receives."""

    def spoil(log: WirelessLog) -> WirelessLog:
        last = max(log.robots())
        own = tuple(m for m in log.measurements if m.receiver == last)
        others = tuple(m for m in log.measurements if m.receiver != last)
        spoilt = fault(replace(log, measurements=own)).measurements
        return replace(log, measurements=tuple(sorted((*others, *spoilt), key=lambda m: m.stamp_ns)))

    return spoil


def own_clocks(log: WirelessLog) -> WirelessLog:
    """Each robot's stamps count from its own first measurement."""
    start: dict[str, int] = {}
    for m in log.measurements:
        start.setdefault(m.receiver, m.stamp_ns)

    def since(m: WirelessMeasurement) -> WirelessMeasurement:
        return replace(m, stamp_ns=m.stamp_ns - start[m.receiver], transmitter_stamp_ns=None)

    return each(since)(log)


def stuck(log: WirelessLog) -> WirelessLog:
    """From a third of the log on, the last value is repeated."""
    third = len(log.measurements) // 3
    held = log.measurements[third]
    after = tuple(
        replace(held, stamp_ns=m.stamp_ns, transmitter_stamp_ns=m.transmitter_stamp_ns)
        for m in log.measurements[third:]
    )
    return replace(log, measurements=(*log.measurements[:third], *after))


def gross(log: WirelessLog) -> WirelessLog:
    """Ranges and azimuths that have nothing to do with the robots."""
    rng = np.random.default_rng(1)
    anywhere = azimuths(lambda _: float(rng.uniform(-np.pi, np.pi)))
    return ranges(lambda _: float(rng.uniform(0.0, 80.0)))(anywhere(log))


def decibels(path: AoaPath) -> AoaPath:
    """Weights as received power, in dB above the noise."""
    return replace(path, weight=max(30.0 + 10.0 * float(np.log10(max(path.weight, 1e-3))), 0.0))


def upside_down(path: AoaPath) -> AoaPath:
    """An antenna array that hangs from the roof: turned about its forward axis."""
    return replace(path, azimuth=-path.azimuth, elevation=None if path.elevation is None else -path.elevation)


def later(seconds: float) -> Fault:
    """All stamps."""
    late_ns = round(seconds * 1e9)

    def shifted(m: WirelessMeasurement) -> WirelessMeasurement:
        sent_ns = None if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns + late_ns
        return replace(m, stamp_ns=m.stamp_ns + late_ns, transmitter_stamp_ns=sent_ns)

    return each(shifted)


def noisy(log: WirelessLog) -> WirelessLog:
    """Ranges with 5 m of noise that the log does not state."""
    rng = np.random.default_rng(2)
    return ranges(lambda r: r + float(rng.normal(0.0, 5.0)))(log)


def sigmas(factor: float) -> Fault:
    """All standard deviations."""
    return lambda log: each_path(lambda p: replace(p, sigma=factor * p.sigma))(ranges(lambda r: r, factor)(log))


BEYOND: Mapping[str, Fault] = {
    "time zone +1 h": later(3600.0),
    "all stamps +3 s": later(3.0),
    "stamps from own start": own_clocks,
    "ranges doubled": ranges(lambda r: 2 * r),
    "ranges in yards": ranges(lambda r: r / 0.9144),
    "azimuth in gradians": azimuths(lambda a: a * 200 / np.pi),
    "azimuth 0 to 2 pi": each_path(lambda p: replace(p, azimuth=float(np.mod(p.azimuth, 2 * np.pi)))),
    "weights in dB": each_path(decibels),
    "stuck": stuck,
    "antenna upside down": each_path(upside_down),
    "one radio +5 m": of_receiver(ranges(lambda r: r + 5.0)),
    "half gross errors": some(0.5, gross),
    "sigmas a hundredth": sigmas(0.01),
    "sigmas times 100": sigmas(100.0),
    "every line twice": lambda log: replace(log, measurements=tuple(m for m in log.measurements for _ in range(2))),
    "every line ten times": lambda log: replace(
        log, measurements=tuple(m for m in log.measurements for _ in "0123456789")
    ),
    "first half missing": lambda log: replace(log, measurements=log.measurements[len(log.measurements) // 2 :]),
    "two radios in one": some(0.5, azimuths(lambda a: a + np.pi / 2)),
    "range noise 5 m": noisy,
    "ranges squared": ranges(lambda r: r * r / 20.0),
}


# Drawn at random ----------------------------------------------------------------------------------------------------


def from_half_way(fault: Fault) -> Fault:
    """A fault that begins in the middle of the log."""

    def spoil(log: WirelessLog) -> WirelessLog:
        half = len(log.measurements) // 2
        spoilt = fault(replace(log, measurements=log.measurements[half:])).measurements
        return replace(log, measurements=(*log.measurements[:half], *spoilt))

    return spoil


def both(one: Fault, other: Fault) -> Fault:
    """Two faults at once."""
    return lambda log: other(one(log))


def drawn(count: int, seed: int) -> dict[str, Fault]:
    """Faults of `FAULTS` and `BEYOND`: two at once, one in one robot's log only, one that begins half-way."""
    rng, known = np.random.default_rng(seed), {**FAULTS, **BEYOND}
    names = [name for name in known if name != "honest"]
    found: dict[str, Fault] = {}
    for n in range(count):
        first, second = rng.choice(names, 2, replace=False).tolist()
        one, other = known[first], known[second]
        ways: list[tuple[str, Fault]] = [
            (f"{first}, {second}", both(one, other)),
            (f"one radio: {first}", of_receiver(one)),
            (f"half: {first}", from_half_way(one)),
        ]
        name, fault = ways[n % len(ways)]
        found[name] = fault
    return found
