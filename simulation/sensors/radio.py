"""Simulated radio between robots: UWB ranges, and bearings with multipath.

Figures of real WiFi profiles (WSR-Toolbox recordings): the strongest path's median error is 7.5 degrees, gross errors
are 10-23 %, a path near the truth exists in 85 % (71-77 % without line of sight).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import accumulate, combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from wiclosure import se3
from wiclosure.errors import ConfigError
from wiclosure.settings import Settings
from wiclosure.simulation.sensors.propagation import InScene, Propagation, Unobstructed
from wiclosure.simulation.sensors.schedule import LinkWindow, link_is_up
from wiclosure.simulation.world.scene import Scene
from wiclosure.types import AoaFrame, AoaPath, FloatArray, Heading, IntArray, Trajectory, WirelessLog
from wiclosure.types import WirelessMeasurement as Measurement

_REPLY_NS = 20_000_000
_PATHS_IN_REAL_PROFILES = (0.54, 0.28, 0.11, 0.04, 0.03)
_MIRROR_GAIN, _DIFFUSE_GAIN, _BLOCKED_GAIN = 0.4, 0.15, 0.3
_FADING_DB = 4.0
_LEAST_SIGMA = 1e-3


class RadioSettings(Settings):
    """How the radio behaves, and how often it is used."""

    direction: Literal["one-way", "reciprocal"] = Field(
        "one-way", description="one-way: the first robot of a pair listens to the second; reciprocal: each to the other"
    )
    every_m: float | None = Field(10.0, gt=0, description="m that the listening robot travels between measurements")
    every_s: float | None = Field(None, gt=0, description="s between measurements, besides those by distance")
    max_range_m: float = Field(150.0, gt=0, description="m, farthest transmission heard with free sight")
    blocked_range: float = Field(0.6, ge=0, le=1, description="share of max_range_m that is reached through walls")
    dropout: float = Field(0.05, ge=0, le=1, description="share of transmissions that get lost")
    ranging: bool = Field(True, description="whether UWB ranges are measured")
    range_sigma_m: float = Field(0.5, ge=0, description="m; the paper's simulation has 0.5")
    range_bias_blocked_m: float = Field(0.6, ge=0, description="m, mean excess range through walls (exponential)")
    gross_ranges: float = Field(0.01, ge=0, le=1, description="share of ranges that are up to 10 m too long")
    bearings: bool = Field(True, description="whether angles of arrival are measured")
    azimuth_sigma_deg: float = Field(10.0, ge=0, description="degrees; real profiles: median error 7.5, paper: 10")
    elevations: bool = Field(False, description="whether the antenna tells elevations")
    aoa_frame: AoaFrame = Field("body", description="axes of the bearings")
    direct_absent: float = Field(0.15, ge=0, le=1, description="share of profiles without the direct path, free sight")
    direct_absent_blocked: float = Field(0.3, ge=0, le=1, description="the same through walls")
    paths: int | None = Field(
        None,
        ge=1,
        le=50,
        description="paths a profile, the direct one being one of them if it is there; none given: 1 to 5, as often as"
        " in real WiFi profiles",
    )
    reflections: bool = Field(True, description="whether walls of the scene mirror; else all false paths are diffuse")
    heading_sigma_deg: float | None = Field(None, ge=0, description="degrees; none given: robots have no compass")
    heading_every_s: float = Field(1.0, gt=0, description="s between compass readings")
    heading_memory_s: float = Field(
        30.0, ge=0, description="s over which a compass error fades: steel nearby disturbs many readings alike"
    )
    schedule: tuple[LinkWindow, ...] | None = Field(None, description="when links are up; none: always")


@dataclass(frozen=True, slots=True, eq=False)
class _Transmissions:
    """N transmissions on one link: stamps `(N,)`, antenna positions `(N, 3)`, `T_axes_world (N, 3, 3)`."""

    stamps_ns: IntArray
    receiver_m: FloatArray
    transmitter_m: FloatArray
    R_axes_world: FloatArray
    blocked: NDArray[np.bool_]


def simulate_wireless_from_poses(
    ground_truth: Mapping[str, Trajectory], settings: RadioSettings, seed: int
) -> WirelessLog:
    """The radio of robots whose true poses in one frame are known, in free space with random false paths."""
    return _simulate(ground_truth, Unobstructed(), settings, seed)


def simulate_wireless(
    ground_truth: Mapping[str, Trajectory], scene: Scene, settings: RadioSettings, seed: int
) -> WirelessLog:
    """The radio of robots in a scene: walls block and mirror."""
    return _simulate(ground_truth, InScene(scene), settings, seed)


def _simulate(
    ground_truth: Mapping[str, Trajectory], propagation: Propagation, settings: RadioSettings, seed: int
) -> WirelessLog:
    if settings.every_m is None and settings.every_s is None:
        raise ConfigError("the radio is never used: set every_m or every_s")
    mission_ns = min(int(truth.stamps_ns[0]) for truth in ground_truth.values())
    measurements: list[Measurement] = []
    for number, (first, second) in enumerate(combinations(ground_truth.values(), 2)):
        rng = np.random.default_rng([seed, 1, number])
        stamps_ns = _moments(first, second, settings, mission_ns)
        measurements += _link(first, second, stamps_ns, propagation, settings, rng)
        if settings.direction == "reciprocal":
            measurements += _link(second, first, stamps_ns + _REPLY_NS, propagation, settings, rng)
    headings = [
        heading
        for number, truth in enumerate(ground_truth.values())
        for heading in _headings(truth, settings, np.random.default_rng([seed, 2, number]))
    ]
    return WirelessLog(tuple(measurements), tuple(headings)) + WirelessLog()  # adding sorts by time


def _moments(receiver: Trajectory, transmitter: Trajectory, settings: RadioSettings, mission_ns: int) -> IntArray:
    """Stamps at which the link is used, while both robots are on the road."""
    start_ns = int(receiver.stamps_ns[0])
    seconds = (receiver.stamps_ns - start_ns) * 1e-9
    chosen = [np.zeros(0)]
    if settings.every_m is not None:
        metres = np.arange(1, int(receiver.distance[-1] / settings.every_m) + 1) * settings.every_m
        # Where the robot stood, several stamps share one distance: the first counts.
        moved = np.append(True, np.diff(receiver.distance) > 0)
        chosen.append(np.interp(metres, receiver.distance[moved], seconds[moved]))
    if settings.every_s is not None:
        chosen.append(np.arange(settings.every_s, seconds[-1], settings.every_s))
    stamps_ns = start_ns + np.round(np.unique(np.concatenate(chosen)) * 1e9).astype(np.int64)
    both = receiver.covers(stamps_ns) & transmitter.covers(stamps_ns)
    mission_s: FloatArray = (stamps_ns - mission_ns) / 1e9
    up = link_is_up(settings.schedule, receiver.robot, transmitter.robot, mission_s)
    return stamps_ns[both & up]


def _link(
    receiver: Trajectory,
    transmitter: Trajectory,
    stamps_ns: IntArray,
    propagation: Propagation,
    settings: RadioSettings,
    rng: np.random.Generator,
) -> list[Measurement]:
    """What the receiver learns from the transmitter at the given stamps."""
    heard = _heard(receiver, transmitter, stamps_ns, propagation, settings, rng)
    ranges = _ranges(heard, settings, rng)
    profiles = _profiles(heard, propagation, settings, rng)
    sigma_m = max(settings.range_sigma_m, _LEAST_SIGMA)
    return [
        Measurement(
            int(stamp_ns),
            receiver.robot,
            transmitter.robot,
            range_m=float(range_m) if settings.ranging else None,
            range_sigma_m=sigma_m if settings.ranging else None,
            paths=paths,
            aoa_frame=settings.aoa_frame,
        )
        for stamp_ns, range_m, paths in zip(heard.stamps_ns, ranges, profiles, strict=True)
        if settings.ranging or paths
    ]


def _heard(
    receiver: Trajectory,
    transmitter: Trajectory,
    stamps_ns: IntArray,
    propagation: Propagation,
    settings: RadioSettings,
    rng: np.random.Generator,
) -> _Transmissions:
    """The transmissions within reach that did not get lost."""
    T_world_receiver = receiver.at(stamps_ns)
    at_receiver, at_transmitter = T_world_receiver[:, :3, 3], transmitter.at(stamps_ns)[:, :3, 3]
    blocked = propagation.blocked(at_receiver, at_transmitter)
    reach = settings.max_range_m * np.where(blocked, settings.blocked_range, 1.0)
    distance = np.linalg.norm(at_transmitter - at_receiver, axis=1)
    kept = (distance <= reach) & (rng.random(len(stamps_ns)) >= settings.dropout)
    match settings.aoa_frame:
        case "body":
            R_world_axes = T_world_receiver[:, :3, :3]
        case "odometry":
            R_world_axes = np.broadcast_to(receiver.poses[0, :3, :3], (len(stamps_ns), 3, 3))
        case "world":
            R_world_axes = np.broadcast_to(np.eye(3), (len(stamps_ns), 3, 3))
    R_axes_world = np.swapaxes(R_world_axes, 1, 2)
    return _Transmissions(stamps_ns[kept], at_receiver[kept], at_transmitter[kept], R_axes_world[kept], blocked[kept])


def _ranges(heard: _Transmissions, settings: RadioSettings, rng: np.random.Generator) -> FloatArray:
    """Measured ranges `(N,)`."""
    count = len(heard.stamps_ns)
    distance = np.linalg.norm(heard.transmitter_m - heard.receiver_m, axis=1)
    noise = settings.range_sigma_m * rng.standard_normal(count)
    bias = np.where(heard.blocked, settings.range_bias_blocked_m * rng.standard_exponential(count), 0.0)
    gross = np.where(rng.random(count) < settings.gross_ranges, rng.uniform(1.0, 10.0, count), 0.0)
    return np.asarray(np.maximum(distance + noise + bias + gross, 0.0))


def _profiles(
    heard: _Transmissions, propagation: Propagation, settings: RadioSettings, rng: np.random.Generator
) -> Iterable[tuple[AoaPath, ...]]:
    """The paths of each transmission, strongest first."""
    count = len(heard.stamps_ns)
    if not settings.bearings:
        return [()] * count
    absent = np.where(heard.blocked, settings.direct_absent_blocked, settings.direct_absent)
    direct = rng.random(count) >= absent
    if settings.paths is None:
        paths = 1 + rng.choice(len(_PATHS_IN_REAL_PROFILES), size=count, p=_PATHS_IN_REAL_PROFILES)
    else:
        paths = np.full(count, settings.paths)
    false_paths = paths - direct
    mirrored = Unobstructed().reflections(heard.receiver_m, heard.transmitter_m)
    if settings.reflections:
        mirrored = propagation.reflections(heard.receiver_m, heard.transmitter_m)
    found = []
    for row in range(count):
        virtual_m = mirrored.virtual_m[mirrored.transmission == row]
        direction, gain = _arrivals(heard, row, virtual_m, (int(direct[row]), int(false_paths[row])), rng)
        found.append(_as_paths(direction, gain, settings, rng))
    return found


def _arrivals(
    heard: _Transmissions, row: int, virtual_m: FloatArray, paths: tuple[int, int], rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Directions `(P, 3)` in the axes of the measurement, and gains `(P,)`, of one profile.

    `paths` are numbers of direct ones, 0 or 1, and of false ones: first mirrored, then diffuse.
    """
    direct, false_paths = paths
    true = heard.transmitter_m[row] - heard.receiver_m[row]
    mirrored = virtual_m - heard.receiver_m[row]
    mirrored = mirrored[np.argsort(np.linalg.norm(mirrored, axis=1))][:false_paths]
    around = rng.uniform(-np.pi, np.pi, false_paths - len(mirrored))
    diffuse = np.stack([np.cos(around), np.sin(around), rng.normal(0.0, 0.1, len(around))], axis=1)
    direction = np.vstack([true[None][:direct], mirrored, diffuse])
    gain = np.concatenate(
        [
            np.full(direct, _BLOCKED_GAIN if heard.blocked[row] else 1.0),
            _MIRROR_GAIN * (true @ true) / np.maximum(np.einsum("ij,ij->i", mirrored, mirrored), 1e-6),
            np.full(len(diffuse), _DIFFUSE_GAIN),
        ]
    )
    return direction @ heard.R_axes_world[row].T, gain


def _as_paths(
    direction: FloatArray, gain: FloatArray, settings: RadioSettings, rng: np.random.Generator
) -> tuple[AoaPath, ...]:
    """Noisy angles and weights of directions `(P, 3)` in the axes of the measurement."""
    sigma = np.deg2rad(settings.azimuth_sigma_deg)
    weight = gain * 10 ** (_FADING_DB / 10 * rng.standard_normal(len(gain)))
    weight /= max(float(weight.sum()), 1e-12)
    azimuth = np.arctan2(direction[:, 1], direction[:, 0]) + sigma * rng.standard_normal(len(gain))
    azimuth = np.arctan2(np.sin(azimuth), np.cos(azimuth))
    level = np.hypot(direction[:, 0], direction[:, 1])
    elevation = np.arctan2(direction[:, 2], level) + sigma * rng.standard_normal(len(gain))
    elevation = np.clip(elevation, -np.pi / 2, np.pi / 2)
    return tuple(
        AoaPath(
            float(azimuth[path]),
            max(float(sigma), _LEAST_SIGMA),
            float(weight[path]),
            float(elevation[path]) if settings.elevations else None,
        )
        for path in np.argsort(-weight)
    )


def _headings(truth: Trajectory, settings: RadioSettings, rng: np.random.Generator) -> list[Heading]:
    """Compass readings of one robot."""
    if settings.heading_sigma_deg is None:
        return []
    sigma = np.deg2rad(settings.heading_sigma_deg)
    stamps_ns = np.arange(
        truth.stamps_ns[0], truth.stamps_ns[-1] + 1, round(settings.heading_every_s * 1e9), dtype=np.int64
    )
    yaw = se3.yaw(truth.at(stamps_ns)) + sigma * _fading(len(stamps_ns), settings, rng)
    return [
        Heading(int(stamp_ns), truth.robot, float(angle), max(float(sigma), _LEAST_SIGMA))
        for stamp_ns, angle in zip(stamps_ns, np.arctan2(np.sin(yaw), np.cos(yaw)), strict=True)
    ]


def _fading(count: int, settings: RadioSettings, rng: np.random.Generator) -> FloatArray:
    """Standard normal numbers `(N,)`, each alike to the ones before (first-order Gauss-Markov)."""
    kept = np.exp(-settings.heading_every_s / max(settings.heading_memory_s, 1e-9))
    fresh = np.sqrt(1 - kept**2)
    steps = fresh * rng.standard_normal(count)
    steps[:1] /= fresh
    return np.fromiter(accumulate(steps, lambda last, step: kept * last + step), float, count)
