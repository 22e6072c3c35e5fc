"""`closures.csv`: every proposed closure, how far it came, and why no further."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure.formats.stamps import seconds_text
from wiclosure.types import Closure, Evidence, Trajectory

_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_KEYS = ("query_robot", "query_index", "query_stamp", "match_robot", "match_index", "match_stamp")
COLUMNS = (*_KEYS, "decision", "reason", *_POSE, *(f.name for f in fields(Evidence)))


def write_closures(path: Path, closures: Sequence[Closure], keyframes: Mapping[str, Trajectory]) -> None:
    """Writes one row a closure; the pose is `T_query_match`, empty fields are unknown.

    Args:
        path: the file.
        closures: in the order of the rows.
        keyframes: keyframe trajectories by robot, for the stamps.
    """
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for closure in closures:
            pose = [*closure.T_query_match[:3, 3], *Rotation.from_matrix(closure.T_query_match[:3, :3]).as_quat()]
            keys = [
                value
                for key in (closure.query, closure.match)
                for value in (key.robot, key.index, *seconds_text([int(keyframes[key.robot].stamps_ns[key.index])]))
            ]
            evidence = ["" if np.isnan(value) else f"{value:.6g}" for value in asdict(closure.evidence).values()]
            writer.writerow([*keys, closure.decision, closure.reason, *(f"{value:.6f}" for value in pose), *evidence])
