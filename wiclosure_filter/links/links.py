"""All measurements between two robots as arrays: what multipath rejection, alignment and graph factors work on.

One row is one measurement that both trajectories cover.  Everything is stated for robots a and b, whichever of them
received: `antenna_a` lies in the odometry frame of a, `antenna_b` in that of b.  A frame transform `X = T_a_b` predicts

    displacement (receiver to transmitter, in the receiver's odometry axes)
        a received:  v = X(antenna_b) - antenna_a
        b received:  v = X^-1(antenna_a) - antenna_b
    range |v|; bearing: azimuth and elevation of `R_odom_axes^T v`.

For factors between keyframes, `antenna_keyframe_a` is the antenna in the body frame of keyframe `index_a`, and
`R_keyframe_axes` turns the axes of the angles into the body axes of the receiver's keyframe.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from wiclosure.types import BoolArray, FloatArray, IntArray

_NEIGHBOURS = 4


@dataclass(frozen=True, eq=False)
class Links:
    """M measurements between robots a and b, at most K paths each.

    Args:
        robot_a, robot_b: the robots.
        measurement: `(M,)` index into `WirelessLog.measurements`, increasing.
        a_receives: `(M,)` true where a measured b's signal.
        stamp_a_ns, stamp_b_ns: `(M,)` times at the two robots.
        index_a, index_b: `(M,)` keyframes nearest in time.
        antenna_a, antenna_b: `(M, 3)` antenna positions, each in its own robot's odometry frame, metres.
        antenna_keyframe_a, antenna_keyframe_b: `(M, 3)` the same in the body frames of those keyframes.
        range_m, range_sigma_m: `(M,)`; NaN where nothing was ranged.
        R_odom_axes: `(M, 3, 3)` from the axes of the angles into the receiver's odometry axes.
        R_keyframe_axes: `(M, 3, 3)` from the axes of the angles into the body axes of the receiver's keyframe.
        azimuth, sigma: `(M, K)` rad; 0 and 1 where there is no such path.
        elevation: `(M, K)` rad; NaN where it was not measured.
        weight: `(M, K)`, sums to 1 over the paths of a measurement; 0 where there is no such path.
        path: `(M, K)` index into the measurement's paths; -1 where there is no such path.
        yaw: `(M,)` rad, yaw of odometry frame b in a by the robots' headings; NaN where one is not known.
        yaw_sigma: `(M,)` rad.
        left_out: sentences on measurements of this pair that are not among the M.
    """

    robot_a: str
    robot_b: str
    measurement: IntArray
    a_receives: BoolArray
    stamp_a_ns: IntArray
    stamp_b_ns: IntArray
    index_a: IntArray
    index_b: IntArray
    antenna_a: FloatArray
    antenna_b: FloatArray
    antenna_keyframe_a: FloatArray
    antenna_keyframe_b: FloatArray
    range_m: FloatArray
    range_sigma_m: FloatArray
    R_odom_axes: FloatArray
    R_keyframe_axes: FloatArray
    azimuth: FloatArray
    elevation: FloatArray
    sigma: FloatArray
    weight: FloatArray
    path: IntArray
    yaw: FloatArray
    yaw_sigma: FloatArray
    left_out: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.measurement)

    def subset(self, rows: IntArray) -> Links:
        """The measurements at `rows`."""
        whole = {"robot_a", "robot_b", "left_out"}
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name not in whole})

    def exchanged(self) -> Links:
        """The same with a and b in each other's place."""
        return replace(
            self,
            robot_a=self.robot_b,
            robot_b=self.robot_a,
            a_receives=~self.a_receives,
            stamp_a_ns=self.stamp_b_ns,
            stamp_b_ns=self.stamp_a_ns,
            index_a=self.index_b,
            index_b=self.index_a,
            antenna_a=self.antenna_b,
            antenna_b=self.antenna_a,
            antenna_keyframe_a=self.antenna_keyframe_b,
            antenna_keyframe_b=self.antenna_keyframe_a,
            yaw=-self.yaw,
        )

    def in_stretch(self, start_a: int, start_b: int) -> Links:
        """The same of trajectories that begin at later keyframes."""
        return replace(self, index_a=self.index_a - start_a, index_b=self.index_b - start_b)

    def thinned(self, most: int) -> Links:
        """At most so many measurements, evenly over the time; neighbours stay together: one may range, one bear."""
        if len(self) <= most:
            return self
        order = np.argsort(self.stamp_a_ns, kind="stable")
        starts = np.linspace(0, len(self) - _NEIGHBOURS, most // _NEIGHBOURS).astype(np.int64)
        rows = np.sort(order[np.unique(starts[:, None] + np.arange(_NEIGHBOURS))])
        sentence = f"{len(rows)} of {len(self)} measurements were looked at, evenly over the time"
        return replace(self.subset(rows), left_out=(*self.left_out, sentence))

    def at(self, robot: str) -> tuple[IntArray, FloatArray]:
        """Keyframes `(M,)` and antenna positions `(M, 3)` of one of the robots, in its odometry frame."""
        return (self.index_a, self.antenna_a) if robot == self.robot_a else (self.index_b, self.antenna_b)

    @property
    def heard(self) -> bool:
        """Whether the robots measured each other at all, even where nothing of it can be used."""
        return len(self) > 0 or bool(self.left_out)

    @property
    def has_range(self) -> BoolArray:
        """`(M,)` true where a range was measured."""
        return np.isfinite(self.range_m)

    @property
    def has_bearing(self) -> BoolArray:
        """`(M,)` true where a direction was measured."""
        return np.asarray((self.path >= 0).any(axis=1))

    @property
    def direction(self) -> FloatArray:
        """`(M, K, 3)` unit directions to the transmitter in the receiver's odometry axes.

        A path without elevation counts as horizontal in the axes of its angles.
        """
        elevation = np.nan_to_num(self.elevation)
        in_axes = np.stack(
            [
                np.cos(elevation) * np.cos(self.azimuth),
                np.cos(elevation) * np.sin(self.azimuth),
                np.sin(elevation),
            ],
            axis=-1,
        )
        return np.asarray(np.einsum("mij,mkj->mki", self.R_odom_axes, in_axes))
