"""Systematic errors that no correction knows, alone and together: nothing may be called certain and wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from systematic_faults import FAULTS, Case, Fault, clocks, each, each_path, jump, scaled
from systematic_worlds import Hearing

from wiclosure import se3
from wiclosure.types import FloatArray, WirelessMeasurement


def of_log(change: Callable[[list[WirelessMeasurement]], list[WirelessMeasurement]]) -> Callable[..., Case]:
    """The log changed as a whole."""
    return lambda case, _: replace(case, log=replace(case.log, measurements=tuple(change(list(case.log.measurements)))))


def stuck(log: list[WirelessMeasurement]) -> list[WirelessMeasurement]:
    """From two thirds on, the receiver repeats its last value."""
    last = log[2 * len(log) // 3]
    return [replace(m, range_m=last.range_m, paths=last.paths) if m.stamp_ns > last.stamp_ns else m for m in log]


def repeated(log: list[WirelessMeasurement]) -> list[WirelessMeasurement]:
    """Each is written five times, milliseconds apart."""
    return [replace(m, stamp_ns=m.stamp_ns + 5_000_000 * k) for m in log for k in range(5)]


def backwards(log: list[WirelessMeasurement]) -> list[WirelessMeasurement]:
    """The last measurement has the first stamp."""
    return [replace(m, stamp_ns=n.stamp_ns) for m, n in zip(log[::-1], log, strict=True)]


def sometimes_longer(m: WirelessMeasurement) -> WirelessMeasurement:
    """Every other range goes by a reflection."""
    return replace(m, range_m=(m.range_m or 0.0) + m.stamp_ns // 1_000_000_000 // 4 % 2 * 5.0)


def _times(factor: float) -> Callable[[WirelessMeasurement], WirelessMeasurement]:
    """Ranges in another unit, or by another speed of light."""
    return lambda m: replace(m, range_m=(m.range_m or 0.0) * factor)


def fast_clock(case: Case, _: np.random.Generator) -> Case:
    """Robot b's clock runs 3 % too fast."""
    b = case.odometry["b"]
    stamps_ns = b.stamps_ns[0] + ((b.stamps_ns - b.stamps_ns[0]) * 1.03).astype(np.int64)
    return replace(case, odometry={**case.odometry, "b": replace(b, stamps_ns=stamps_ns)})


def wandering_bias(case: Case, _: np.random.Generator) -> Case:
    """Ranges grow by 4 m over the log, as of an antenna that warms up."""
    first, last = case.log.measurements[0].stamp_ns, case.log.measurements[-1].stamp_ns
    return each(lambda m: replace(m, range_m=(m.range_m or 0.0) + 4.0 * (m.stamp_ns - first) / max(last - first, 1)))(
        case, _
    )


def gross(share: float) -> Callable[[Case, np.random.Generator], Case]:
    """So many ranges are anything up to 60 m, and their directions as well."""

    def spoil(case: Case, rng: np.random.Generator) -> Case:
        def change(m: WirelessMeasurement) -> WirelessMeasurement:
            if rng.uniform() > share:
                return m
            paths = tuple(replace(p, azimuth=float(rng.uniform(-np.pi, np.pi))) for p in m.paths)
            return replace(m, range_m=float(rng.uniform(0, 60)), paths=paths)

        return each(change)(case, rng)

    return spoil


def missing(case: Case, _: np.random.Generator) -> Case:
    """Robot b hears nothing in the second half, and a nothing in the first."""
    half = len(case.log.measurements) // 2
    return of_log(lambda log: [m for n, m in enumerate(log) if (m.receiver == "a") == (n >= half)])(case, _)


def moved(change: Callable[[FloatArray], FloatArray]) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's odometry changed, from its first pose on."""

    def spoil(case: Case, _: np.random.Generator) -> Case:
        b = case.odometry["b"]
        poses = b.poses[0] @ change(se3.inverse(b.poses[0]) @ b.poses)
        return replace(case, odometry={**case.odometry, "b": replace(b, poses=poses)})

    return spoil


def turning(degrees: float) -> Callable[[FloatArray], FloatArray]:
    """Yaw drifts evenly, by so much in all, as of a gyroscope with a bias."""

    def change(poses: FloatArray) -> FloatArray:
        steps = se3.between(poses[:-1], poses[1:])
        turn = se3.from_yaw(np.full(len(steps), np.radians(degrees) / len(steps)), np.zeros((len(steps), 3)))
        bent = [poses[0]]
        for step in steps @ turn:
            bent.append(bent[-1] @ step)
        return np.array(bent)

    return change


def climbing(poses: FloatArray) -> FloatArray:
    """Height that is not there, 10 % of the way, as of a LiDAR mounted tilted."""
    poses = poses.copy()
    poses[1:, 2, 3] += 0.1 * np.cumsum(np.linalg.norm(np.diff(poses[:, :2, 3], axis=0), axis=1))
    return poses


def standing(case: Case, _: np.random.Generator) -> Case:
    """Odometry of robot b says that it stands still from the middle on: its LiDAR is stuck."""
    half = len(case.odometry["b"]) // 2
    return moved(lambda poses: np.concatenate([poses[:half], np.broadcast_to(poses[half], poses[half:].shape)]))(
        case, _
    )


def longer(metres: float) -> Callable[[Case, np.random.Generator], Case]:
    """Ranges that are too long throughout."""
    return each(lambda m: replace(m, range_m=(m.range_m or 0.0) + metres))


def both(*spoils: Callable[[Case, np.random.Generator], Case]) -> Callable[[Case, np.random.Generator], Case]:
    """One fault after the other."""

    def spoil(case: Case, rng: np.random.Generator) -> Case:
        for one in spoils:
            case = one(case, rng)
        return case

    return spoil


def any_two(case: Case, rng: np.random.Generator) -> Case:
    """Two of the faults of logs and odometry that corrections know, drawn at random."""
    one, other = rng.choice(len(_DRAWN), 2, replace=False)
    return both(_DRAWN[one], _DRAWN[other])(case, rng)


_DRAWN = tuple(fault.spoil for fault in FAULTS[5:] if fault.robots == 2)

# No correction knows these.
UNSEEN = (
    Fault("ranges bent by distance", 3, spoil=each(lambda m: replace(m, range_m=(m.range_m or 0.0) ** 2 / 20.0))),
    Fault("ranges in yards", 3, spoil=each(_times(1 / 0.9144)), words=("range",)),
    Fault("ranges of light in a cable", 3, spoil=each(_times(1.5)), words=("range",)),
    Fault("azimuth in gradians", 3, spoil=each_path(lambda a: a * 200 / np.pi), words=("azimuths",)),
    Fault("odometry in mph", 3, spoil=scaled(1.609), words=("odometry", "ranges")),
    Fault("azimuths halved", 3, spoil=each_path(lambda a: a / 2)),
    Fault("half of the ranges +5 m", 3, spoil=each(sometimes_longer)),
    Fault("receiver gets stuck", 3, spoil=of_log(stuck)),
    Fault("each measurement five times", 1, spoil=of_log(repeated)),
    Fault("clock 3 % fast", 3, spoil=fast_clock),
    Fault("log runs backwards", 3, spoil=of_log(backwards)),
    Fault("ranges grow by 4 m", 3, spoil=wandering_bias),
    Fault("half of the log is gross", 3, spoil=gross(0.5)),
    Fault("each hears half of the time", 1, Hearing(reciprocal=True), missing),
    Fault("stamps in leap seconds", 3, spoil=clocks(18.0)),
    Fault("scale 20 %", 3, spoil=scaled(1.2)),
    Fault("yaw drifts by 40 deg", 3, spoil=moved(turning(40.0))),
    Fault("climbs by 10 %", 3, spoil=moved(climbing)),
    Fault("odometry of b stuck", 3, spoil=standing),
    Fault("+3 m and clocks 0.5 s", 3, spoil=both(longer(3.0), clocks(0.5))),
    Fault("mirror and clockwise", 3, Hearing(mirror=6.0), each_path(lambda a: -a)),
    Fault("nlos and scale 3 %", 3, Hearing(bias_m=2.0), scaled(1.03)),
    Fault("slip in a team", 3, spoil=jump(5.0, 0.0), robots=3),
    Fault("mirror-hidden team", 15, Hearing(mirror=6.0, mirror_only=0.85), robots=3),
    Fault("any two", 3, spoil=any_two),
    Fault("any two, reciprocal", 3, Hearing(reciprocal=True), any_two),
)
