"""Trajectories in files of any kind that is known: TUM, EuRoC, KITTI poses."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal, TypeAlias

from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.formats.plausible import plausible_path
from wiclosure.formats.text_cells import is_number
from wiclosure.formats.text_table import encoding_of
from wiclosure.formats.trajectories.euroc import is_euroc, read_euroc
from wiclosure.formats.trajectories.kitti_poses import read_kitti_poses
from wiclosure.formats.trajectories.tum import read_tum
from wiclosure.types import Trajectory

TrajectoryKind: TypeAlias = Literal["tum", "euroc", "kitti"]


def trajectory_kind(path: Path) -> TrajectoryKind:
    """What kind a file is, by its first line of numbers; `tum` where nothing tells.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        with path.open(encoding=encoding_of(path), errors="replace") as file:
            for line in file:
                words = line.partition("#")[0].split()
                if is_euroc(line):
                    return "euroc"
                if words and words[0][0] in "+-.0123456789":
                    words = [word for word in re.split(r"[\s,]+", line.partition("#")[0]) if word]
                    return "kitti" if len(words) in {12, 13, 16, 17} and all(map(is_number, words)) else "tum"
    except OSError as error:
        raise InputError(f"cannot read the trajectory {path}: {error.strerror}; check the path") from error
    return "tum"


def read_trajectory(path: Path | str, robot: str, drift: DriftModel | None = None) -> Trajectory:
    """The trajectory in a TUM or EuRoC file, or one of KITTI poses with a stamp before each.

    Raises:
        InputError: the file cannot be read, or holds KITTI poses without stamps.
    """
    path = Path(path)
    match trajectory_kind(path):
        case "euroc":
            return read_euroc(path, robot, drift)
        case "kitti":
            poses, _, stamps_ns = read_kitti_poses(path)
            if stamps_ns is None:
                raise InputError(
                    f"{path} holds KITTI poses, which carry no stamps; give a TUM file (stamp x y z qx qy qz qw)"
                )
            near = plausible_path(path, stamps_ns, poses[:, :3, 3])
            return Trajectory(robot, stamps_ns[near], poses[near], drift or DriftModel())
    return read_tum(path, robot, drift)
