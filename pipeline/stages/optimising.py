"""What `wiclosure optimize` does: several robots' graphs in, one estimate out, every closure with its reason."""

from __future__ import annotations

import csv
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.markup import escape
from rich.table import Table

from wiclosure.backends.config import ClosureNoise, PcmSettings, PoseGraphSettings
from wiclosure.backends.g2o_lines import pose_name
from wiclosure.backends.g2o_reader import G2oTeam, read_g2o
from wiclosure.backends.g2o_writer import write_g2o
from wiclosure.backends.graph_result import GraphResult
from wiclosure.backends.pcm import PcmResult, pairwise_consistent
from wiclosure.backends.pose_graph import optimise
from wiclosure.formats.kitti_poses import write_kitti_poses
from wiclosure.formats.tum import write_tum
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.runtime.output import write_json
from wiclosure.pipeline.stages.closures_csv import decision
from wiclosure.types import Closure, KeyframeId

logger = logging.getLogger(__name__)

STATED_IN_FULL = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
MAX_SCALE = 10.0  # stated covariances are often set by hand, and ten times too small is not rare
MANY_ROWS = 40
COLUMNS = ("first", "second", "decision", "reason", "residual_m", "residual_rad", "agrees_with", "place")


@dataclass(frozen=True, eq=False)
class Merged:
    """What was read, what consistency said, the estimate, and how long it took."""

    team: G2oTeam
    consistent: PcmResult
    graph: GraphResult
    seconds: float

    @property
    def diagnosis(self) -> tuple[str, ...]:
        """All sentences for the user."""
        return (*self.team.warnings, *self.consistent.diagnosis, *self.graph.diagnosis)

    def name(self, key: KeyframeId) -> str:
        """As the files have it."""
        return pose_name(key.robot, int(self.team.indices[key.robot][key.index]))


def merge(paths: Sequence[Path], config: Config) -> Merged:
    """Reads the graphs, decides on their closures and estimates all poses.

    Covariances are taken as the files state them, times what `pcm.max_scale` allows, unless the configuration says
    otherwise.

    Raises:
        InputError: a file cannot be used.
    """
    began = time.perf_counter()
    team = read_g2o(paths)
    for sentence in team.warnings:
        logger.warning("%s", sentence)
    if team.unusable:
        first, more = team.unusable[0], len(team.unusable) - 1
        rest = f" (and {more} more closures, see closures.csv)" if more else ""
        logger.warning("%s: left out, %s%s", first.place, first.reason, rest)
    pcm = _defaults(config.pcm, noise=STATED_IN_FULL, max_scale=MAX_SCALE)
    consistent = pairwise_consistent(team.closures, team.odometry, pcm)
    settings = _defaults(config.pose_graph, noise=STATED_IN_FULL).scaled(consistent.scale)
    graph = optimise(team.odometry, consistent.closures, settings)
    return Merged(team, consistent, graph, time.perf_counter() - began)


S = TypeVar("S", PcmSettings, PoseGraphSettings)


def _defaults(settings: S, **values: object) -> S:
    """With these values where the user set none."""
    unset = {name: value for name, value in values.items() if name not in settings.model_fields_set}
    return settings.model_copy(update=unset)


def write(folder: Path, merged: Merged) -> None:
    """Writes all files into an existing folder."""
    write_g2o(merged.graph, folder / "graph.g2o", merged.team.keys)
    for robot, trajectory in merged.graph.trajectories.items():
        stem = robot if robot.translate(str.maketrans("", "", "_-.")).isalnum() else f"robot_{ord(robot[0])}"
        write_tum(folder / f"{stem}.tum", trajectory)
        write_kitti_poses(folder / f"{stem}_kitti.txt", trajectory.poses)
    with (folder / "closures.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.DictWriter(file, COLUMNS)
        rows.writeheader()
        rows.writerows(_rows(merged))
    write_json(folder / "summary.json", summary(merged))


def summary(merged: Merged) -> dict[str, Any]:
    """Figures and sentences, fit for JSON."""
    rows = _rows(merged)
    return {
        "robots": {robot: len(trajectory) for robot, trajectory in merged.graph.trajectories.items()},
        "components": [list(group) for group in merged.graph.components],
        "closures": {
            "read": len(rows),
            "accepted": sum(row["decision"] == "accepted" for row in rows),
            "rejected": [row for row in rows if row["decision"] != "accepted"],
        },
        "ambiguous": [[pair.robot_a, pair.robot_b] for pair in merged.consistent.pairs if pair.ambiguous],
        "sigma_scale": merged.consistent.scale,
        "seconds": round(merged.seconds, 3),
        "diagnosis": list(merged.diagnosis),
    }


def tables(merged: Merged) -> list[Table]:
    """For the terminal: what was found, and the closures that were rejected."""
    found = summary(merged)
    overview = Table(title="optimize", show_header=False)
    overview.add_row("robots", ", ".join(f"{escape(robot)}: {n} poses" for robot, n in found["robots"].items()))
    overview.add_row("closures", f"{found['closures']['accepted']} of {found['closures']['read']} accepted")
    overview.add_row("connected", "; ".join(escape(", ".join(group)) for group in found["components"]))
    overview.add_row("seconds", f"{found['seconds']:.1f}")
    for sentence in found["diagnosis"]:
        overview.add_row("", escape(sentence))
    rejected = found["closures"]["rejected"]
    if not rejected:
        return [overview]
    table = Table("closure", "reason", "m off", "degrees off", title="rejected closures")
    for row in rejected[:MANY_ROWS]:
        metres, radians = row["residual_m"], row["residual_rad"]
        off = ("-", "-") if metres is None else (f"{metres:.2f}", f"{np.degrees(radians):.1f}")
        table.add_row(f"{escape(row['first'])} - {escape(row['second'])}", escape(row["reason"]), *off)
    if len(rejected) > MANY_ROWS:
        table.caption = f"and {len(rejected) - MANY_ROWS} more in closures.csv"
    return [overview, table]


def _rows(merged: Merged) -> list[dict[str, Any]]:
    """One row a closure, those that could not be used last."""
    rows = [_row(merged, c, place) for c, place in zip(merged.graph.closures, merged.team.places, strict=True)]
    unknown = dict.fromkeys(("residual_m", "residual_rad"))
    return rows + [
        {"first": u.first, "second": u.second, "decision": "rejected", "reason": u.reason, **unknown, "agrees_with": 0}
        | {"place": u.place}
        for u in merged.team.unusable
    ]


def _row(merged: Merged, closure: Closure, place: str) -> dict[str, Any]:
    residual = closure.residual
    return {
        "first": merged.name(closure.query),
        "second": merged.name(closure.match),
        "decision": decision(closure),
        "reason": closure.reason,
        "residual_m": None if residual is None else round(residual.translation_m, 6),
        "residual_rad": None if residual is None else round(residual.rotation_rad, 6),
        "agrees_with": closure.consistent_with,
        "place": place,
    }
