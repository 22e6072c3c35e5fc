"""What is known before robots meet: each one's odometry in its own frame, beside the others', and pairs across them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr

from wiclosure.colours import robot_rgb
from wiclosure.frontends.front_end import Followed
from wiclosure.frontends.front_end_result import FrontEndResult
from wiclosure.pipeline.report.viewer import columns
from wiclosure.types import CandidatePairs, Closure, FloatArray, IntArray, KeyframeId, Trajectory

SPACE = "odometry"
CANDIDATES = 2_000
BESIDE_M = 10.0
PALE, GREY, ORANGE, BLUE = (190, 190, 190), (120, 120, 120), (213, 94, 0), (0, 114, 178)


@dataclass(frozen=True, eq=False)
class OwnFrames:
    """Where each robot's own frame is drawn, and its keyframes.

    Args:
        offset: `(3,)` m by robot, to add to positions in its odometry frame.
        keyframes: odometry by robot.
    """

    offset: Mapping[str, FloatArray]
    keyframes: Mapping[str, Trajectory]

    @classmethod
    def of(cls, fronts: Mapping[str, FrontEndResult]) -> OwnFrames:
        """One after the other along y, so that no two overlap."""
        offset, edge_m = dict[str, FloatArray](), 0.0
        for robot, front in fronts.items():
            low, high = front.odometry.positions.min(axis=0), front.odometry.positions.max(axis=0)
            offset[robot] = np.array([-low[0], edge_m - high[1], 0.0])
            edge_m -= high[1] - low[1] + BESIDE_M
        return cls(offset, {robot: front.keyframes for robot, front in fronts.items()})

    def positions(self, robot: str) -> FloatArray:
        """Of the keyframes, as drawn."""
        return self.keyframes[robot].positions + self.offset[robot]

    def ends(self, pairs: Sequence[tuple[KeyframeId, KeyframeId]]) -> tuple[IntArray, FloatArray]:
        """When both keyframes of each pair were there, ns `(N,)`, and where they are drawn `(N, 2, 3)`."""
        stamps = [max(self.keyframes[k.robot].stamps_ns[k.index] for k in pair) for pair in pairs]
        drawn = {robot: self.positions(robot) for robot in self.keyframes}
        places = [[drawn[k.robot][k.index] for k in pair] for pair in pairs]
        return np.array(stamps, np.int64), np.array(places, float).reshape(-1, 2, 3)


def show_scan(recording: rr.RecordingStream, robot: str, number: int, followed: Followed) -> None:
    """A scan that odometry has just followed, in the robot's own frame."""
    path = f"{SPACE}/now/{rr.escape_entity_path_part(robot)}"
    recording.set_time(columns.TIME, timestamp=np.datetime64(followed.stamp_ns, "ns"))
    T_odom_body = followed.T_odom_body
    recording.log(path, rr.Transform3D(translation=T_odom_body[:3, 3], mat3x3=T_odom_body[:3, :3]))
    recording.log(f"{path}/scan", rr.Points3D(followed.points, colors=robot_rgb(number)))
    recording.reset_time()


def show_fronts(recording: rr.RecordingStream, fronts: Mapping[str, FrontEndResult], frames: OwnFrames) -> list[str]:
    """Odometry and keyframes of every robot.

    Returns:
        Paths of the entities whose rows stay, here as in what follows.
    """
    lasting = []
    recording.log(f"{SPACE}/now", rr.Clear(recursive=True))
    for number, (robot, front) in enumerate(fronts.items()):
        path, colour = f"{SPACE}/{rr.escape_entity_path_part(robot)}", robot_rgb(number)
        recording.log(path, rr.Transform3D(translation=frames.offset[robot]), static=True)
        recording.log(f"{path}/path", rr.LineStrips3D([front.odometry.positions], colors=colour), static=True)
        recording.log(
            f"{path}/keyframes", rr.Points3D.from_fields(colors=colour, radii=rr.Radius.ui_points(3)), static=True
        )
        columns.points(
            recording, f"{path}/keyframes", front.keyframes.stamps_ns, list(front.keyframes.positions[:, None])
        )
        columns.poses(recording, f"{path}/body", front.odometry.stamps_ns, front.odometry.poses)
        recording.log(f"{path}/body", rr.TransformAxes3D(2.0), static=True)
        lasting.append(f"{path}/keyframes")
    return lasting


def show_candidates(recording: rr.RecordingStream, kept: Sequence[CandidatePairs], frames: OwnFrames) -> list[str]:
    """Kept pairs, each from the moment when both keyframes were there; of very many some, evenly."""
    lasting = []
    every = max(1, -(-sum(len(pairs) for pairs in kept) // CANDIDATES))
    for pairs in kept:
        rows = slice(None, None, every)
        a, b = pairs.index_a[rows], pairs.index_b[rows]
        path = f"{SPACE}/candidates/{rr.escape_entity_path_part(f'{pairs.robot_a}-{pairs.robot_b}')}"
        recording.log(path, rr.Clear(recursive=True))
        recording.log(path, rr.LineStrips3D.from_fields(colors=PALE, radii=rr.Radius.ui_points(0.7)), static=True)
        ends = np.stack([frames.positions(pairs.robot_a)[a], frames.positions(pairs.robot_b)[b]], axis=1)
        of_a, of_b = frames.keyframes[pairs.robot_a], frames.keyframes[pairs.robot_b]
        columns.lines(recording, path, np.maximum(of_a.stamps_ns[a], of_b.stamps_ns[b]), ends)
        lasting.append(path)
    return lasting


def show_closures(recording: rr.RecordingStream, closures: Sequence[Closure], frames: OwnFrames) -> list[str]:
    """Closures across the frames: proposed, or by what registration and radio check said of them."""
    groups: dict[str, list[Closure]] = {"proposed": [], "checked": [], "rejected": []}
    for closure in closures:
        name = "rejected" if closure.rejected_at is not None else "proposed" if closure.measured is None else "checked"
        groups[name].append(closure)
    for (name, group), colour in zip(groups.items(), (GREY, BLUE, ORANGE), strict=True):
        path = f"{SPACE}/closures/{name}"
        recording.log(path, rr.Clear(recursive=True))
        recording.log(path, rr.LineStrips3D.from_fields(colors=colour, show_labels=False), static=True)
        stamps_ns, ends = frames.ends([(c.query, c.match) for c in group])
        columns.lines(recording, path, stamps_ns, ends, [caption(closure) for closure in group])
    return [f"{SPACE}/closures/{name}" for name in groups]


def caption(closure: Closure) -> str:
    """What hovering over a closure says."""
    fate = "accepted" if closure.rejected_at is None else f"rejected by {closure.rejected_at}"
    reason = f": {closure.reason}" if closure.reason else ""
    return f"{closure.query} and {closure.match}, {fate}{reason}"
