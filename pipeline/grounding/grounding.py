"""What robots know of the Earth, before they meet: their frames stand upright, and some know where they are."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from wiclosure import se3
from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.factor_graph.earth_factors import OUTVOTED, weights_of_fixes, weights_of_up
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.inertial.bridging import bridged
from wiclosure.frontends.inertial.estimate import UpEstimate, estimate_up
from wiclosure.geodesy import enu_of
from wiclosure.pipeline.config import EarthSettings
from wiclosure.pipeline.data.inputs import GnssInput, ImuInput, Inputs
from wiclosure.pipeline.evaluation.metrics import EarthMetrics
from wiclosure.pipeline.grounding.fixes import credible
from wiclosure.types import EarthMeasurements, FloatArray, PositionFixes, Trajectory

logger = logging.getLogger(__name__)

CORRELATED_S = 60.0  # satellites' and air's errors last: so long, fixes tell no more than one
TELLING_TILT_RAD = np.radians(0.5)  # of a frame, from which it is worth a sentence


@dataclass(frozen=True, eq=False)
class Grounding:
    """What is known of the Earth, and the front ends in frames that stand upright.

    Args:
        fronts: by robot; those whose up is known in an odometry frame whose z points there.
        earth: measurements at keyframes.
        T_level_odom: `(4, 4)` by robot: how its odometry was turned.
        origin: `(3,)` latitude and longitude (degrees) and height (m) of the local frame, or None without positions.
        sentences: for the user.
        seconds: wall time of it.
    """

    fronts: dict[str, FrontEndResult] = field(default_factory=dict)
    earth: EarthMeasurements = field(default_factory=EarthMeasurements)
    T_level_odom: Mapping[str, FloatArray] = field(default_factory=dict)
    origin: FloatArray | None = None
    sentences: tuple[str, ...] = ()
    seconds: float = 0.0


def grounded(fronts: Mapping[str, FrontEndResult], inputs: Inputs, settings: EarthSettings) -> Grounding:
    """Finds up along every robot's odometry that has an IMU, and brings all positions into one local frame."""
    began = time.perf_counter()
    upright, level, up, sentences = dict(fronts), dict[str, FloatArray](), {}, list[str]()
    for robot in inputs.robots:
        if robot.imu is None or not settings.gravity:
            continue
        front, found, told = _with_imu(robot.imu, fronts[robot.robot])
        if len(found.slips):
            front = front.slipping(found.slips)
        upright[robot.robot] = front
        sentences += [f"{robot.robot}: {sentence}" for sentence in (*found.sentences, *told, *_tilt(found))]
        if found.up is not None and found.T_level_odom is not None:
            up[robot.robot], level[robot.robot] = found.up, found.T_level_odom
            upright[robot.robot] = front.moved(found.T_level_odom)
    receivers = dict[str, GnssInput]()
    for robot in inputs.robots:
        if robot.gnss is not None and settings.gnss:
            receivers[robot.robot], told = credible(robot.gnss, upright[robot.robot].keyframes)
            sentences += [f"{robot.robot}: {sentence}" for sentence in told]
    origin = next((receiver.log.geodetic[0] for receiver in receivers.values() if len(receiver.log)), None)
    fixes = {}
    for name, receiver in receivers.items():
        if origin is not None:
            fixes[name] = _fixes(receiver, upright[name].keyframes, origin)
        if not len(fixes.get(name, ())):
            sentences.append(
                f"{name}: none of its {len(receiver.log)} usable GNSS fixes lies within the time of its scans"
            )
    return Grounding(
        upright, EarthMeasurements(up, fixes), level, origin, tuple(sentences), time.perf_counter() - began
    )


def _with_imu(imu: ImuInput, front: FrontEndResult) -> tuple[FrontEndResult, UpEstimate, list[str]]:
    """Up along the odometry, which is the IMU's own where the two depart, and a sentence where."""
    found = estimate_up(imu.log, front.odometry, front.keyframes, imu.T_lidar_imu)
    given, mounting = imu.T_lidar_imu, found.mounting
    if given is not None:
        R_body_imu, lever_m = given[:3, :3], given[:3, 3]
    elif mounting is not None:
        R_body_imu, lever_m = mounting.R_body_imu, None
    if found.fit is None or found.up is None:
        return front, found, []
    mended = bridged(front.odometry, imu.log, found.fit, R_body_imu, lever_m)
    if not mended.steps.any():
        return front, found, []
    front = front.replaced(mended.odometry, mended.steps)
    return front, estimate_up(imu.log, front.odometry, front.keyframes, given), [mended.sentence()]


def earth_metrics(grounding: Grounding, graph: GraphResult) -> EarthMetrics:
    """What the estimate made of it."""
    earth, poses = grounding.earth, {robot: t.poses for robot, t in graph.trajectories.items()}
    first = graph.components[0][0]
    placed, upright = list(graph.ground.placed), any(robot in earth.up for robot in graph.components[0])
    where = grounding.origin if placed else None
    return {
        "frame": "east-north-up" if first in placed else "upright" if upright else "odometry",
        "origin": None
        if where is None
        else dict(zip(("latitude", "longitude", "height_m"), where.tolist(), strict=True)),
        "placed": placed,
        "up": {
            robot: {
                "count": len(up),
                "sigma_deg": float(np.degrees(np.median(up.sigma_rad))),
                "outvoted": int((weights_of_up(up, poses[robot]) < OUTVOTED).sum()),
            }
            for robot, up in earth.up.items()
            if len(up)
        },
        "fixes": {
            robot: {"count": len(own), "outvoted": int((weights_of_fixes(own, poses[robot]) < OUTVOTED).sum())}
            for robot, own in earth.fixes.items()
            if robot in placed
        },
    }


def _tilt(found: UpEstimate) -> list[str]:
    """A sentence on an odometry frame that does not stand upright."""
    if found.T_level_odom is None:
        return []
    tilt_rad = float(se3.rotation_angle(found.T_level_odom))
    if tilt_rad < TELLING_TILT_RAD:
        return []
    return [f"its odometry frame leans by {np.degrees(tilt_rad):.1f} degrees; it was set upright"]


def _fixes(receiver: GnssInput, keyframes: Trajectory, origin: FloatArray) -> PositionFixes:
    """At the nearest keyframes, with sigmas as if errors were independent, while they last for a minute."""
    stamps_ns = receiver.log.stamps_ns
    inside = keyframes.covers(stamps_ns)
    log, stamps_ns = receiver.log, stamps_ns[inside]
    position, sigma = enu_of(log.geodetic[inside], origin), log.sigma_enu[inside]
    if not len(stamps_ns):
        return PositionFixes(np.zeros(0, np.int64), position, sigma, position)
    near = keyframes.nearest(stamps_ns)
    moved = se3.between(keyframes.poses[near], keyframes.at(stamps_ns))
    antenna = moved[:, :3, :3] @ receiver.antenna_lidar + moved[:, :3, 3]
    interval_s = float(np.median(np.diff(stamps_ns))) * 1e-9 if len(stamps_ns) > 1 else CORRELATED_S
    alike = max(1.0, CORRELATED_S / max(interval_s, 1e-3))
    return PositionFixes(near, position, sigma * np.sqrt(alike), antenna)
