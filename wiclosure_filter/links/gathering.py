"""From the wireless log to links: each measurement between two robots where both trajectories were when it was made."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.headings import OdometryHeading, odometry_headings
from wiclosure.wiclosure_filter.links.links import Links
from wiclosure.wiclosure_filter.links.paths import PaddedPaths


@dataclass(frozen=True, slots=True)
class GatheringLimits:
    """Which measurements become links.

    Args:
        stamp_tolerance_s: s, how far outside a trajectory's time a measurement may lie.
        heading_tolerance_s: s between a measurement and the headings that are used with it.
        max_paths: strongest paths of a measurement that are kept.
        use_headings: whether compasses tell how the odometry frames are turned to each other.
    """

    stamp_tolerance_s: float
    heading_tolerance_s: float
    max_paths: int
    use_headings: bool

    @classmethod
    def of(cls, settings: AlignmentSettings) -> GatheringLimits:
        """As the settings of the alignment have them."""
        return cls(
            stamp_tolerance_s=settings.stamp_tolerance_s,
            heading_tolerance_s=settings.heading_tolerance_s,
            max_paths=settings.radio.max_paths,
            use_headings=settings.heading in {"auto", "heading"},
        )


@dataclass(frozen=True, eq=False)
class TeamLinks:
    """The measurements between the robots of a team as arrays, gathered once.

    Args:
        headings: readings of each robot that has a compass, as the yaw of its odometry frame.
        by_pair: links of every pair of robots that measured each other, a before b in the order of the trajectories;
            asked for other pairs, it gives no links.
    """

    headings: Mapping[str, OdometryHeading]
    by_pair: Mapping[tuple[str, str], Links]

    @classmethod
    def of(cls, trajectories: Mapping[str, Trajectory], wireless: WirelessLog, limits: GatheringLimits) -> TeamLinks:
        """Gathers and normalises all measurements.

        Measurements outside a trajectory's time are left out, and so are bearings in world axes of a receiver whose
        heading is not known; `Links.left_out` says how many.
        """
        headings = odometry_headings(trajectories, wireless)
        order = {robot: number for number, robot in enumerate(trajectories)}
        rows: dict[tuple[str, str], list[int]] = defaultdict(list)
        for row, measurement in enumerate(wireless.measurements):
            if measurement.receiver in order and measurement.transmitter in order:
                a, b = sorted((measurement.receiver, measurement.transmitter), key=order.__getitem__)
                rows[a, b].append(row)

        def gathered(a: str, b: str) -> Links:
            between = _Between.of((a, b), trajectories, wireless, rows.get((a, b), []))
            return between.links((headings.get(a), headings.get(b)), limits)

        by_pair = _LinksByPair(gathered)
        by_pair |= {pair: gathered(*pair) for pair in sorted(rows, key=lambda pair: [order[robot] for robot in pair])}
        return cls(headings, by_pair)


class _LinksByPair(dict[tuple[str, str], Links]):
    """Links of the robots that measured each other; of others, none, made when they are asked for."""

    def __init__(self, gathered: Callable[[str, str], Links]) -> None:
        super().__init__()
        self._gathered = gathered

    def __missing__(self, pair: tuple[str, str]) -> Links:
        return self._gathered(*pair)


@dataclass(frozen=True, eq=False)
class _Between:
    """M measurements between two robots, as the log has them.

    Args:
        robots: a and b.
        trajectories: of a and b.
        rows: `(M,)` of the log.
        measurements: those at `rows`.
        a_receives: `(M,)`.
        stamps_ns: `(M,)` each, times at a and at b.
    """

    robots: tuple[str, str]
    trajectories: tuple[Trajectory, Trajectory]
    rows: IntArray
    measurements: Sequence[WirelessMeasurement]
    a_receives: BoolArray
    stamps_ns: tuple[IntArray, IntArray]

    @classmethod
    def of(
        cls,
        robots: tuple[str, str],
        trajectories: Mapping[str, Trajectory],
        wireless: WirelessLog,
        rows: Sequence[int],
    ) -> _Between:
        chosen = [wireless.measurements[row] for row in rows]
        a_receives = np.array([m.receiver == robots[0] for m in chosen], bool)
        both = (trajectories[robots[0]], trajectories[robots[1]])
        return cls(robots, both, np.array(rows, np.int64), chosen, a_receives, _stamps(chosen, a_receives))

    def links(self, headings: tuple[OdometryHeading | None, OdometryHeading | None], limits: GatheringLimits) -> Links:
        """The links, and sentences on those that are none."""
        tolerance_ns = round(limits.stamp_tolerance_s * 1e9)
        inside_a, inside_b = (
            trajectory.covers(stamps_ns, tolerance_ns)
            for trajectory, stamps_ns in zip(self.trajectories, self.stamps_ns, strict=True)
        )
        inside = np.flatnonzero(inside_a & inside_b)
        outside = len(self.rows) - len(inside)
        lost = (f"{outside} of {len(self.rows)} measurements lie outside the trajectories' time",) if outside else ()
        return self._subset(inside)._as_arrays(headings, limits, lost)

    def _subset(self, chosen: IntArray) -> _Between:
        return replace(
            self,
            rows=self.rows[chosen],
            measurements=[self.measurements[row] for row in chosen],
            a_receives=self.a_receives[chosen],
            stamps_ns=(self.stamps_ns[0][chosen], self.stamps_ns[1][chosen]),
        )

    def _as_arrays(
        self,
        headings: tuple[OdometryHeading | None, OdometryHeading | None],
        limits: GatheringLimits,
        left_out: tuple[str, ...],
    ) -> Links:
        chosen, a_receives = self.measurements, self.a_receives
        a, b = (
            _Side.of(trajectory, stamps_ns, _arms(chosen, receives), heading, limits.heading_tolerance_s)
            for trajectory, stamps_ns, receives, heading in zip(
                self.trajectories, self.stamps_ns, (a_receives, ~a_receives), headings, strict=True
            )
        )
        R_odom_axes, axes_sigma = _axes(chosen, a_receives, (a, b))
        directed = np.isfinite(axes_sigma)
        paths = PaddedPaths.strongest(chosen, directed, limits.max_paths)
        lost = sum(bool(m.paths) for m, ok in zip(chosen, directed, strict=True) if not ok)
        R_odom_keyframe = np.where(a_receives[:, None, None], a.R_odom_keyframe, b.R_odom_keyframe)
        yaw = se3.wrap_angle(b.yaw_world_odom - a.yaw_world_odom)
        return Links(
            robot_a=self.robots[0],
            robot_b=self.robots[1],
            measurement=self.rows,
            a_receives=a_receives,
            stamp_a_ns=self.stamps_ns[0],
            stamp_b_ns=self.stamps_ns[1],
            index_a=a.index,
            index_b=b.index,
            antenna_a=a.antenna,
            antenna_b=b.antenna,
            antenna_keyframe_a=a.antenna_keyframe,
            antenna_keyframe_b=b.antenna_keyframe,
            range_m=_or_nan([m.range_m for m in chosen]),
            range_sigma_m=_or_nan([m.range_sigma_m for m in chosen]),
            R_odom_axes=R_odom_axes,
            R_keyframe_axes=np.swapaxes(R_odom_keyframe, 1, 2) @ R_odom_axes,
            azimuth=paths.azimuth,
            elevation=paths.elevation,
            sigma=np.where(paths.index >= 0, np.hypot(paths.sigma, np.nan_to_num(axes_sigma)[:, None]), 1.0),
            weight=paths.weight,
            path=paths.index,
            yaw=yaw if limits.use_headings else np.full(len(yaw), np.nan),
            yaw_sigma=np.hypot(a.heading_sigma, b.heading_sigma),
            left_out=(*left_out, f"{lost} bearings in world axes lack the receiver's heading") if lost else left_out,
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


def _or_nan(values: Sequence[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], float)


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
        heading_tolerance_s: float,
    ) -> _Side:
        T_odom_body = trajectory.at(stamps_ns)
        index = trajectory.nearest(stamps_ns)
        T_odom_keyframe = trajectory.poses[index]
        antenna = se3.transform(T_odom_body, arms)
        unknown = np.full(len(stamps_ns), np.nan)
        yaw, sigma = (unknown, unknown) if heading is None else heading.at(stamps_ns, heading_tolerance_s)
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
    chosen: Sequence[WirelessMeasurement], a_receives: BoolArray, sides: tuple[_Side, _Side]
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
