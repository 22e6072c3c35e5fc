"""Systematic errors of logs and odometry, one at a time, and how many wrong alignments each may cause."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from systematic_worlds import Hearing, wrap

from wiclosure import se3
from wiclosure.types import FloatArray, Trajectory, WirelessLog, WirelessMeasurement


@dataclass(frozen=True, eq=False)
class Case:
    """What the filter is given: keyframe odometry and log, and the truth to hold its answer against."""

    truth: dict[str, Trajectory]
    odometry: dict[str, Trajectory]
    log: WirelessLog


@dataclass(frozen=True)
class Fault:
    """One systematic error.

    Args:
        name: as in the table.
        goal: most trials of 90 that may be certain and wrong.
        hearing: how the radio is heard.
        spoil: what is done to the case.
        words: any of these in the diagnosis names it; empty where naming is not asked for.
        robots: how many.
    """

    name: str
    goal: int
    hearing: Hearing = field(default_factory=Hearing)
    spoil: Callable[[Case, np.random.Generator], Case] = lambda case, _: case
    words: tuple[str, ...] = ()
    robots: int = 2


def each_path(change: Callable[[float], float]) -> Callable[[Case, np.random.Generator], Case]:
    """Azimuths changed."""

    def spoil(case: Case, _: np.random.Generator) -> Case:
        changed = tuple(
            replace(m, paths=tuple(replace(p, azimuth=wrap(change(p.azimuth))) for p in m.paths))
            for m in case.log.measurements
        )
        return replace(case, log=replace(case.log, measurements=changed))

    return spoil


def each(change: Callable[[WirelessMeasurement], WirelessMeasurement]) -> Callable[[Case, np.random.Generator], Case]:
    """Measurements changed."""
    return lambda case, _: replace(
        case, log=replace(case.log, measurements=tuple(change(m) for m in case.log.measurements))
    )


def clocks(seconds: float) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's clock is ahead."""

    def spoil(case: Case, rng: np.random.Generator) -> Case:
        b = case.odometry["b"]
        shift = int(seconds * 1e9) * (1 if rng.uniform() < 0.5 else -1)
        return replace(case, odometry={**case.odometry, "b": replace(b, stamps_ns=b.stamps_ns + shift)})

    return spoil


def scaled(factor: float) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's odometry is too long or too short."""

    def spoil(case: Case, rng: np.random.Generator) -> Case:
        b, by = case.odometry["b"], factor if rng.uniform() < 0.5 else 1 / factor
        poses = b.poses.copy()
        poses[:, :3, 3] = poses[0, :3, 3] + by * (poses[:, :3, 3] - poses[0, :3, 3])
        return replace(case, odometry={**case.odometry, "b": replace(b, poses=poses)})

    return spoil


def jump(metres: float, degrees: float) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's odometry misses a move in the middle third of its way."""

    def spoil(case: Case, rng: np.random.Generator) -> Case:
        b = case.odometry["b"]
        at = int(rng.uniform(0.35, 0.65) * len(b))
        side = rng.uniform(-np.pi, np.pi)
        missed = se3.from_yaw(
            np.radians(degrees) * (1 if rng.uniform() < 0.5 else -1),
            metres * np.array([np.cos(side), np.sin(side), 0.0]),
        )
        poses = b.poses.copy()
        poses[at:] = b.poses[at] @ missed @ se3.inverse(b.poses[at]) @ b.poses[at:]
        return replace(case, odometry={**case.odometry, "b": replace(b, poses=poses)})

    return spoil


def swapped(names: Mapping[str, str]) -> Callable[[Case, np.random.Generator], Case]:
    """Robots' names are mixed up in the log."""
    return each(
        lambda m: replace(
            m, receiver=names.get(m.receiver, m.receiver), transmitter=names.get(m.transmitter, m.transmitter)
        )
    )


def in_axes(axes: FloatArray) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's odometry in other axes: of its frame and of its body."""

    def spoil(case: Case, _: np.random.Generator) -> Case:
        b = case.odometry["b"]
        poses = b.poses.copy()
        poses[:, :3, :3] = axes @ poses[:, :3, :3] @ axes
        poses[:, :3, 3] = poses[:, :3, 3] @ axes
        return replace(case, odometry={**case.odometry, "b": replace(b, poses=poses)})

    return spoil


def compass_off(degrees: float) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's compass is turned."""

    def spoil(case: Case, _: np.random.Generator) -> Case:
        off = np.radians(degrees)
        headings = tuple(replace(h, heading=wrap(h.heading + off)) if h.robot == "b" else h for h in case.log.headings)
        return replace(case, log=replace(case.log, headings=headings))

    return spoil


FEET = 3.28084
LEFT_HANDED, NED = np.diag([1.0, -1.0, 1.0]), np.diag([1.0, -1.0, -1.0])

FAULTS = (
    Fault("none", 1),
    Fault("nlos bias", 1, Hearing(bias_m=2.0)),
    Fault("reciprocal", 1, Hearing(reciprocal=True)),
    Fault("mirror", 3, Hearing(mirror=6.0)),
    Fault("mirror, direct gone", 15, Hearing(mirror=6.0, mirror_only=0.85)),
    Fault("clocks 0.5 s", 1, spoil=clocks(0.5), words=("clock",)),
    Fault("clocks 2 s", 3, spoil=clocks(2.0), words=("clock",)),
    Fault("scale 3 %", 2, spoil=scaled(1.03)),
    Fault("scale 10 %", 5, spoil=scaled(1.10)),
    Fault("slip 5 m", 3, spoil=jump(5.0, 0.0)),
    Fault("slip 5 m, 30 deg", 3, spoil=jump(5.0, 30.0)),
    Fault("kidnapped 20 m", 3, spoil=jump(20.0, 0.0)),
    Fault("ids swapped", 3, spoil=swapped({"a": "b", "b": "a"})),
    Fault("ids of three swapped", 10, spoil=swapped({"a": "b", "b": "c", "c": "a"}), robots=3),
    Fault("azimuth clockwise", 3, spoil=each_path(lambda a: -a), words=("clockwise",)),
    Fault("clockwise, reciprocal", 3, Hearing(reciprocal=True), each_path(lambda a: -a), ("clockwise",)),
    Fault("azimuth from the left", 3, spoil=each_path(lambda a: a - np.pi / 2), words=("from the left",)),
    Fault("azimuth reversed", 3, spoil=each_path(lambda a: a + np.pi), words=("reversed",)),
    Fault("azimuth +20 deg", 3, spoil=each_path(lambda a: a + np.radians(20)), words=("mounted", "azimuth offset")),
    Fault("azimuth in degrees", 3, spoil=each_path(np.degrees), words=("azimuths",)),
    Fault("odometry y right", 3, spoil=in_axes(LEFT_HANDED), words=("y to the right",)),
    Fault("odometry NED", 3, spoil=in_axes(NED), words=("y to the right",)),
    Fault("ranges in feet", 2, spoil=each(lambda m: replace(m, range_m=(m.range_m or 0.0) * FEET)), words=("feet",)),
    Fault(
        "ranges +3 m",
        2,
        spoil=each(lambda m: replace(m, range_m=(m.range_m or 0.0) + 3.0)),
        words=("too long", "range bias"),
    ),
    Fault(
        "sigmas ten times too small",
        2,
        spoil=each(
            lambda m: replace(
                m,
                range_sigma_m=(m.range_sigma_m or 0.1) / 10,
                paths=tuple(replace(p, sigma=p.sigma / 10) for p in m.paths),
            )
        ),
    ),
    Fault("compass off by 20 deg", 2, Hearing(headings=True), compass_off(20.0)),
    Fault("compass off by 180 deg", 2, Hearing(headings=True), compass_off(180.0)),
)
