"""The files that `wiclosure optimize` leaves behind."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import numpy as np

from wiclosure.backends.graph_files.g2o_writer import PLANAR, SPATIAL, write_g2o
from wiclosure.backends.graph_files.jrr_writer import write_robot_results
from wiclosure.formats.trajectories.kitti_poses import write_kitti_poses
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.runtime.output import write_json
from wiclosure.pipeline.stages.closures_csv import decision
from wiclosure.pipeline.stages.optimising import MergedGraphs
from wiclosure.types import Closure

OPTIMISED_COLUMNS = ("first", "second", "decision", "reason", "residual_m", "residual_rad", "agrees_with", "place")


class LabelScores(TypedDict):
    """How the decisions agree with the labels of the files; shares are None where nothing was to find."""

    true: int
    false: int
    accepted_true: int
    accepted_false: int
    precision: float | None
    recall: float | None


class MergedSummary(TypedDict):
    """What `summary.json` holds."""

    robots: dict[str, int]
    components: list[list[str]]
    closures: dict[str, Any]
    labels: NotRequired[LabelScores]
    ambiguous: list[list[str]]
    sigma_scale: float
    ignored: dict[str, int]
    seconds: float
    doubts: list[str]
    diagnosis: list[str]


def write_merged(folder: Path, merged: MergedGraphs) -> None:
    """Writes all files into an existing folder."""
    team, trajectories = merged.team, merged.graph.trajectories
    write_g2o(merged.graph, folder / "graph.g2o", team.keys, PLANAR if team.planar else SPATIAL, team.unnamed)
    for robot, trajectory in trajectories.items():
        write_tum(folder / f"{_file_stem(robot)}.tum", trajectory)
        write_kitti_poses(folder / f"{_file_stem(robot)}_kitti.txt", trajectory.poses)
    with (folder / "closures.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.DictWriter(file, OPTIMISED_COLUMNS)
        rows.writeheader()
        rows.writerows(_rows(merged))
    if team.from_robot_log:
        stated = zip(team.edges, team.copies, merged.graph.closures, strict=True)
        outliers = [[edge, *copies] for edge, copies, closure in stated if closure.rejected_at is not None]
        rejected = [edge.factor for edges in outliers for edge in edges if edge.factor]
        poses = {robot: trajectory.poses for robot, trajectory in trajectories.items()}
        write_robot_results(folder / "results.jrr", team.title, poses, team.keys, rejected, planar=team.planar)
    write_json(folder / "summary.json", summary(merged))


def _file_stem(robot: str) -> str:
    """The robot's name, unless it has characters that file systems refuse."""
    return (
        robot
        if robot.translate(str.maketrans("", "", "_-.")).isalnum()
        else "_".join(["robot", *(str(ord(sign)) for sign in robot)])
    )


def summary(merged: MergedGraphs) -> MergedSummary:
    """Figures and sentences, fit for JSON."""
    rows = _rows(merged)
    found = MergedSummary(
        robots={robot: len(trajectory) for robot, trajectory in merged.graph.trajectories.items()},
        components=[list(group) for group in merged.graph.components],
        closures={
            "read": len(rows),
            "accepted": sum(row["decision"] == "accepted" for row in rows),
            "rejected": [row for row in rows if row["decision"] != "accepted"],
        },
        ambiguous=[[pair.robot_a, pair.robot_b] for pair in merged.consistent.pairs if pair.ambiguous],
        sigma_scale=merged.consistent.scale,
        ignored=dict(merged.team.ignored),
        seconds=round(merged.seconds, 3),
        doubts=list(merged.consistent.doubts),
        diagnosis=list(merged.diagnosis),
    )
    if (labels := _label_scores(merged)) is not None:
        found["labels"] = labels
    return found


def _label_scores(merged: MergedGraphs) -> LabelScores | None:
    """The labels that a JSON Robot Log gives its loops against what was decided; None where there are no labels."""
    labelled = [
        (not edge.is_false, closure.rejected_at is None)
        for edge, closure in zip(merged.team.edges, merged.graph.closures, strict=True)
        if edge.is_false is not None
    ]
    if not labelled:
        return None
    true, accepted = (np.array(column, bool) for column in zip(*labelled, strict=True))
    right = int((true & accepted).sum())
    return LabelScores(
        true=int(true.sum()),
        false=int((~true).sum()),
        accepted_true=right,
        accepted_false=int((~true & accepted).sum()),
        precision=right / int(accepted.sum()) if accepted.any() else None,
        recall=right / int(true.sum()) if true.any() else None,
    )


def _rows(merged: MergedGraphs) -> list[dict[str, Any]]:
    """One row per closure, those that could not be used last."""
    rows = [_row(merged, c, edge.place) for c, edge in zip(merged.graph.closures, merged.team.edges, strict=True)]
    unknown = dict.fromkeys(("residual_m", "residual_rad"))
    return rows + [
        {"first": u.first, "second": u.second, "decision": "rejected", "reason": u.reason, **unknown, "agrees_with": 0}
        | {"place": u.place}
        for u in merged.team.unusable
    ]


def _row(merged: MergedGraphs, closure: Closure, place: str) -> dict[str, Any]:
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
