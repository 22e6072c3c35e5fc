"""From the wireless log to links: each measurement between two robots where both trajectories were when it was made."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.alignment.settings import AlignmentSettings
from wiclosure.wiclosure_filter.links.headings import OdometryHeading, odometry_headings
from wiclosure.wiclosure_filter.links.links import Links


def links_between(
    robot_a: str,
    robot_b: str,
    trajectories: Mapping[str, Trajectory],
    wireless: WirelessLog,
    settings: AlignmentSettings,
) -> Links:
    """Gathers and normalises the measurements between two robots.

    Measurements outside a trajectory's time are left out, and so are bearings in world axes of a receiver whose heading
    is not known; `left_out` says how many.
    """
    between = [i for i, m in enumerate(wireless.measurements) if {m.receiver, m.transmitter} == {robot_a, robot_b}]
    return _gather(robot_a, robot_b, np.array(between, np.int64), trajectories, wireless, settings)


def _gather(
    robot_a: str,
    robot_b: str,
    rows: IntArray,
    trajectories: Mapping[str, Trajectory],
    wireless: WirelessLog,
    settings: AlignmentSettings,
) -> Links:
    chosen = [wireless.measurements[i] for i in rows]
    a_receives = np.array([m.receiver == robot_a for m in chosen], bool)
    stamp_a_ns, stamp_b_ns = _stamps(chosen, a_receives)
    tolerance_ns = round(settings.stamp_tolerance_s * 1e9)
    inside = trajectories[robot_a].covers(stamp_a_ns, tolerance_ns)
    inside = inside & trajectories[robot_b].covers(stamp_b_ns, tolerance_ns)
    if not inside.all():
        inner = _gather(robot_a, robot_b, rows[inside], trajectories, wireless, settings)
        lost = f"{int((~inside).sum())} of {len(rows)} measurements lie outside the trajectories' time"
        return replace(inner, left_out=(lost, *inner.left_out))
    headings = odometry_headings(trajectories, wireless, (robot_a, robot_b))
    use_yaw = settings.heading in {"auto", "heading"}
    sides = [
        _Side.of(trajectories[robot], stamps, _arms(chosen, a_receives == is_a), headings.get(robot), settings)
        for robot, stamps, is_a in ((robot_a, stamp_a_ns, True), (robot_b, stamp_b_ns, False))
    ]
    R_odom_axes, extra_sigma = _axes(chosen, a_receives, sides)
    directed = np.isfinite(extra_sigma)
    paths = _paths(chosen, directed, settings.radio.max_paths)
    lost_world = int(sum(bool(m.paths) for m, ok in zip(chosen, directed, strict=True) if not ok))
    receiver_keyframe = np.where(a_receives[:, None, None], sides[0].R_odom_keyframe, sides[1].R_odom_keyframe)
    left_out = (f"{lost_world} bearings in world axes lack the receiver's heading",) if lost_world else ()
    return Links(
        robot_a=robot_a,
        robot_b=robot_b,
        measurement=rows,
        a_receives=a_receives,
        stamp_a_ns=stamp_a_ns,
        stamp_b_ns=stamp_b_ns,
        index_a=sides[0].index,
        index_b=sides[1].index,
        antenna_a=sides[0].antenna,
        antenna_b=sides[1].antenna,
        antenna_keyframe_a=sides[0].antenna_keyframe,
        antenna_keyframe_b=sides[1].antenna_keyframe,
        range_m=np.array([np.nan if m.range_m is None else m.range_m for m in chosen], float),
        range_sigma_m=np.array([np.nan if m.range_sigma_m is None else m.range_sigma_m for m in chosen], float),
        R_odom_axes=R_odom_axes,
        R_keyframe_axes=np.swapaxes(receiver_keyframe, 1, 2) @ R_odom_axes,
        azimuth=paths.azimuth,
        elevation=paths.elevation,
        sigma=np.where(paths.index >= 0, np.hypot(paths.sigma, np.nan_to_num(extra_sigma)[:, None]), 1.0),
        weight=paths.weight,
        path=paths.index,
        yaw=_wrapped(sides[1].yaw_world_odom - sides[0].yaw_world_odom) if use_yaw else np.full(len(rows), np.nan),
        yaw_sigma=np.hypot(sides[0].heading_sigma, sides[1].heading_sigma),
        left_out=left_out,
    )


def _stamps(chosen: Sequence[WirelessMeasurement], a_receives: BoolArray) -> tuple[IntArray, IntArray]:
    receiver = np.array([m.stamp_ns for m in chosen], np.int64)
    transmitter = np.array(
        [m.stamp_ns if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns for m in chosen], np.int64
    )
    return np.where(a_receives, receiver, transmitter), np.where(a_receives, transmitter, receiver)


def _arms(chosen: Sequence[WirelessMeasurement], robot_receives: BoolArray) -> FloatArray:
    """`(M, 3)` lever arms of one robot's antennas, body frame."""
    arms = [
        m.lever_arm_receiver if receives else m.lever_arm_transmitter
        for m, receives in zip(chosen, robot_receives, strict=True)
    ]
    return np.array(arms, float).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class _Side:
    """One robot's part in M measurements."""

    index: IntArray
    antenna: FloatArray
    antenna_keyframe: FloatArray
    R_odom_body: FloatArray
    R_odom_keyframe: FloatArray
    yaw_world_odom: FloatArray
    heading_sigma: FloatArray

    @classmethod
    def of(
        cls,
        trajectory: Trajectory,
        stamps_ns: IntArray,
        arms: FloatArray,
        heading: OdometryHeading | None,
        settings: AlignmentSettings,
    ) -> _Side:
        T_odom_body = trajectory.at(stamps_ns)
        index = trajectory.nearest(stamps_ns)
        T_odom_keyframe = trajectory.poses[index]
        antenna = se3.transform(T_odom_body, arms)
        unknown = np.full(len(stamps_ns), np.nan)
        yaw, sigma = (unknown, unknown) if heading is None else heading.at(stamps_ns, settings.heading_tolerance_s)
        return cls(
            index=index,
            antenna=antenna,
            antenna_keyframe=se3.transform(se3.inverse(T_odom_keyframe), antenna),
            R_odom_body=T_odom_body[:, :3, :3],
            R_odom_keyframe=T_odom_keyframe[:, :3, :3],
            yaw_world_odom=yaw,
            heading_sigma=sigma,
        )


def _axes(
    chosen: Sequence[WirelessMeasurement], a_receives: BoolArray, sides: Sequence[_Side]
) -> tuple[FloatArray, FloatArray]:
    """`R_odom_axes (M, 3, 3)`, and the sigma `(M,)` that the axes add to azimuths; NaN where they are not known."""
    frame = np.array([m.aoa_frame for m in chosen], dtype="<U8")
    body = np.where(a_receives[:, None, None], sides[0].R_odom_body, sides[1].R_odom_body)
    yaw = np.where(a_receives, sides[0].yaw_world_odom, sides[1].yaw_world_odom)
    yaw_sigma = np.where(a_receives, sides[0].heading_sigma, sides[1].heading_sigma)
    world = se3.from_yaw(-np.nan_to_num(yaw), np.zeros((len(yaw), 3)))[:, :3, :3]
    in_world = frame == "world"
    R_odom_axes = np.where(in_world[:, None, None], world, np.eye(3))
    R_odom_axes[frame == "body"] = body[frame == "body"]
    return R_odom_axes, np.where(in_world, yaw_sigma, 0.0)


@dataclass(frozen=True, eq=False)
class _Paths:
    azimuth: FloatArray
    elevation: FloatArray
    sigma: FloatArray
    weight: FloatArray
    index: IntArray


def _paths(chosen: Sequence[WirelessMeasurement], directed: BoolArray, max_paths: int) -> _Paths:
    """The strongest paths of each measurement, padded to one width."""
    count = [len(m.paths) if ok else 0 for m, ok in zip(chosen, directed, strict=True)]
    shape = (len(chosen), max(1, min(max(count, default=0), max_paths)))
    paths = _Paths(np.zeros(shape), np.full(shape, np.nan), np.ones(shape), np.zeros(shape), np.full(shape, -1))
    for row, measurement in enumerate(chosen):
        strongest = sorted(range(count[row]), key=lambda k: -measurement.paths[k].weight)[:max_paths]
        for column, k in enumerate(strongest):
            path = measurement.paths[k]
            paths.azimuth[row, column], paths.sigma[row, column] = path.azimuth, path.sigma
            paths.weight[row, column], paths.index[row, column] = path.weight, k
            if path.elevation is not None:
                paths.elevation[row, column] = path.elevation
    there = paths.index >= 0
    total = paths.weight.sum(axis=1, keepdims=True)
    equal = there / np.maximum(there.sum(axis=1, keepdims=True), 1)
    paths.weight[:] = np.where(total > 0, paths.weight / np.where(total > 0, total, 1.0), equal)
    return paths


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
