"""A finished run as one MCAP file of ROS 2 messages, as Foxglove, RViz and PlotJuggler show them.

Topics: `/map` (PointCloud2), `/tf` and `/<robot>/path` (a robot's merged poses), `/closures` (lines between keyframes).
Robots that are connected share the frame `map`; others have one of their own, `map_<robot>`.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure.errors import InputError, OutputError
from wiclosure.pipeline.data.dataset_writer import ros_stamp_ns
from wiclosure.pipeline.runtime.output import whole_file
from wiclosure.pipeline.sources.clouds.ply import read_ply
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, serialize, typestore
from wiclosure.pipeline.sources.messages.wireless_messages import encode_header
from wiclosure.pipeline.stages.run_folder import read_metrics, read_trajectories
from wiclosure.scratch import temporary_folder
from wiclosure.types import FloatArray, Scan, Trajectory

if TYPE_CHECKING:
    from rosbags.typesys.store import Msg, Typestore

PATH_TYPE, TF_TYPE, MARKERS_TYPE = "nav_msgs/msg/Path", "tf2_msgs/msg/TFMessage", "visualization_msgs/msg/MarkerArray"
COLOURS = {"accepted": (0.0, 0.62, 0.45), "rejected": (0.84, 0.37, 0.0)}
LINE_M = 0.1
_LINE_LIST = 5  # visualization_msgs/Marker.LINE_LIST


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """What a run folder holds of it.

    Args:
        folder: of the run.
        merged: pose of every scan by robot.
        frames: the frame that each robot's poses are in.
        store: ROS 2 message types.
    """

    folder: Path
    merged: Mapping[str, Trajectory]
    frames: Mapping[str, str]
    store: Typestore

    @classmethod
    def of(cls, folder: Path) -> FinishedRun:
        """Reads it.

        Raises:
            InputError: the folder holds no finished run.
        """
        components = [component["robots"] for component in read_metrics(folder)["components"]]
        merged, _ = read_trajectories(folder)
        frames = {
            r: "map" if number == 0 else f"map_{group[0]}" for number, group in enumerate(components) for r in group
        }
        return cls(folder, merged, frames, typestore("cdr"))

    def messages(self) -> Iterator[tuple[int, str, str, Msg]]:
        """Stamp, topic, type and message of everything, in order of time."""
        first_ns = min(int(path.stamps_ns[0]) for path in self.merged.values())
        cloud = read_ply(self.folder / "map.ply")
        scan = Scan(first_ns, cloud.points, intensity=cloud.intensity)
        yield first_ns, "/map", POINT_CLOUD_TYPE, encode_scan(scan, self.store, "map")
        for robot, path in self.merged.items():
            yield first_ns, f"/{robot}/path", PATH_TYPE, self._path(path, first_ns)
        yield first_ns, "/closures", MARKERS_TYPE, self._closures(first_ns)
        steps = (
            (int(s), robot, T)
            for robot, path in self.merged.items()
            for s, T in zip(path.stamps_ns, path.poses, strict=True)
        )
        for stamp_ns, robot, T_map_body in sorted(steps, key=lambda step: step[0]):
            yield stamp_ns, "/tf", TF_TYPE, self._transform(stamp_ns, robot, T_map_body)

    def _make(self, msgtype: str, **fields: Any) -> Msg:
        return self.store.types[msgtype](**fields)

    def _path(self, path: Trajectory, stamp_ns: int) -> Msg:
        frame = self.frames[path.robot]
        poses = [
            self._make(
                "geometry_msgs/msg/PoseStamped",
                header=encode_header(int(stamp), self.store, frame),
                pose=self._make(
                    "geometry_msgs/msg/Pose", position=self._point(T[:3, 3]), orientation=self._quaternion(T)
                ),
            )
            for stamp, T in zip(path.stamps_ns, path.poses, strict=True)
        ]
        return self._make(PATH_TYPE, header=encode_header(stamp_ns, self.store, frame), poses=poses)

    def _transform(self, stamp_ns: int, robot: str, T_map_body: FloatArray) -> Msg:
        x, y, z = T_map_body[:3, 3].tolist()
        transform = self._make(
            "geometry_msgs/msg/Transform",
            translation=self._make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
            rotation=self._quaternion(T_map_body),
        )
        stamped = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=encode_header(stamp_ns, self.store, self.frames[robot]),
            child_frame_id=robot,
            transform=transform,
        )
        return self._make(TF_TYPE, transforms=[stamped])

    def _closures(self, stamp_ns: int) -> Msg:
        """One list of lines each for accepted and rejected closures between robots in the frame `map`."""
        ends = closure_ends(self.folder / "closures.csv", self.merged, self.frames)
        markers = [self._lines(stamp_ns, decision, ends[decision]) for decision in COLOURS]
        return self._make(MARKERS_TYPE, markers=markers)

    def _lines(self, stamp_ns: int, decision: str, ends: FloatArray) -> Msg:
        vector, pose = "geometry_msgs/msg/Vector3", "geometry_msgs/msg/Pose"
        red, green, blue = COLOURS[decision]
        return self._make(
            "visualization_msgs/msg/Marker",
            header=encode_header(stamp_ns, self.store, "map"),
            ns=decision,
            id=0,
            type=_LINE_LIST,
            action=0,
            pose=self._make(pose, position=self._point(np.zeros(3)), orientation=self._quaternion(np.eye(4))),
            scale=self._make(vector, x=LINE_M, y=0.0, z=0.0),
            color=self._make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=1.0),
            lifetime=self._make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
            frame_locked=False,
            points=[self._point(end) for end in ends.reshape(-1, 3)],
            colors=[],
            texture_resource="",
            texture=self._make(
                "sensor_msgs/msg/CompressedImage",
                header=encode_header(0, self.store, ""),
                format="",
                data=np.zeros(0, np.uint8),
            ),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=self._make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )

    def _point(self, xyz: FloatArray) -> Msg:
        x, y, z = xyz.tolist()
        return self._make("geometry_msgs/msg/Point", x=x, y=y, z=z)

    def _quaternion(self, T: FloatArray) -> Msg:
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def closure_ends(path: Path, merged: Mapping[str, Trajectory], frames: Mapping[str, str]) -> dict[str, FloatArray]:
    """Both ends `(K, 2, 3)` m of closures in the frame `map`, by decision (`accepted` or `rejected`).

    Raises:
        InputError: the file cannot be read.
    """
    ends: dict[str, list[FloatArray]] = {decision: [] for decision in COLOURS}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                robots = [row["query_robot"], row["match_robot"]]
                if all(frames[robot] == "map" for robot in robots):
                    stamps_ns = [round(float(row[f"{end}_stamp"]) * 1e9) for end in ("query", "match")]
                    pair = [
                        merged[r].at_or_beyond(np.array([s]))[0, :3, 3] for r, s in zip(robots, stamps_ns, strict=True)
                    ]
                    ends["accepted" if row["decision"] == "accepted" else "rejected"].append(np.array(pair))
    except (OSError, KeyError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({error}); run again") from error
    return {decision: np.array(found).reshape(-1, 2, 3) for decision, found in ends.items()}


def write_mcap(folder: Path, target: Path, *, overwrite: bool = False) -> None:
    """Writes a finished run as an MCAP file.

    Args:
        folder: of the run.
        target: the file, named `.mcap`.
        overwrite: replace it if it exists.

    Raises:
        InputError: the folder holds no finished run.
        OutputError: the file exists, is not named `.mcap`, or cannot be written; or a stamp does not fit ROS.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    if target.suffix != ".mcap":
        raise OutputError(f"--mcap {target}: viewers know such files by the ending .mcap; add it")
    if target.exists() and not overwrite:
        raise OutputError(f"{target} exists already; choose another --mcap, or --overwrite")
    run = FinishedRun.of(folder)
    with temporary_folder() as scratch, whole_file(target) as whole:
        bag = scratch / "run"
        with Writer(bag, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            connections: dict[str, Any] = {}
            for stamp_ns, topic, msgtype, message in run.messages():
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, msgtype, typestore=run.store)
                writer.write(connections[topic], ros_stamp_ns(stamp_ns), serialize(run.store, "cdr", message, msgtype))
        shutil.copyfile(bag / "run.mcap", whole)
