"""What the page shows of `wiclosure filter`: paths as the radio aligns them, kept pairs, links."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from wiclosure import se3
from wiclosure.display import significant
from wiclosure.pipeline.config import Config, dump_config
from wiclosure.pipeline.report.html.advice import ambiguities
from wiclosure.pipeline.report.html.candidates_data import candidate_matrices
from wiclosure.pipeline.report.html.radio_data import Tracks, radio_pair
from wiclosure.pipeline.report.html.scene_data import Placement, robot_entry
from wiclosure.pipeline.report.html.versions import versions
from wiclosure.types import FilterResult, FloatArray, Trajectory, WirelessLog


def filter_data(
    result: FilterResult, trajectories: Mapping[str, Trajectory], wireless: WirelessLog, config: Config
) -> dict[str, Any]:
    """Everything that the page shows of a filter's result.

    Args:
        result: of the filter, with these trajectories and measurements.
        trajectories: as the filter was given them, each in its own odometry frame.
        wireless: measurements.
        config: what it ran with.
    """
    groups = _aligned(result, list(trajectories))
    placed = {robot: trajectories[robot].moved(T) for group in groups for robot, T in group.items()}
    placement = Placement.of([tuple(group) for group in groups], placed)
    began_ns = min(int(path.stamps_ns[0]) for path in trajectories.values())
    return {
        "name": result.filter_name,
        "verdict": _verdict(result),
        "numbers": _numbers(result, wireless),
        "robots": [
            robot_entry(
                number,
                len(trajectories),
                path=placed[robot],
                odometry=path,
                keyframes=placed[robot],
                placement=placement,
            )
            for number, (robot, path) in enumerate(trajectories.items())
        ],
        "map": None,
        "map_note": "Paths that a certain alignment joins lie in one frame; others are drawn beside them.",
        "closures": [],
        "funnel": [
            {"stage": stage, "count": count, "true": None, "false": None, "reasons": []}
            for stage, count in (("pairs", result.pairs_total), ("kept", result.pairs_kept))
        ],
        "matrices": candidate_matrices(result.pairs, trajectories),
        "radio": [
            radio_pair(
                alignment,
                wireless,
                Tracks(placed[alignment.robot_a], placed[alignment.robot_b], placement.offset[alignment.robot_a])
                if placement.together(alignment.robot_a, alignment.robot_b)
                else Tracks(None, None, None),
                began_ns=began_ns,
                of_pairs=len(result.alignments),
            )
            for alignment in result.alignments
        ],
        "tables": [_pairs_table(result, trajectories)],
        "config": dump_config(config),
        "versions": versions(),
    }


def _aligned(result: FilterResult, robots: list[str]) -> list[dict[str, FloatArray]]:
    """Robots that certain alignments join, with `T_group_odom` of each; the largest group first."""
    edges = {
        (al.robot_a, al.robot_b): al.best.T_a_b for al in result.alignments if al.best is not None and not al.ambiguous
    }
    edges |= {(b, a): se3.inverse(T_a_b) for (a, b), T_a_b in edges.items()}
    groups: list[dict[str, FloatArray]] = []
    for first in robots:
        if any(first in group for group in groups):
            continue
        group, waiting = {first: np.eye(4)}, [first]
        while waiting:
            here = waiting.pop()
            found = {b: group[here] @ T for (a, b), T in edges.items() if a == here and b not in group}
            group |= found
            waiting += found
        groups.append(group)
    return sorted(groups, key=len, reverse=True)


def _verdict(result: FilterResult) -> dict[str, Any]:
    unsure = ambiguities(result.alignments)
    certain = len(result.alignments) - len(unsure)
    sentence = f"The filter {result.filter_name} keeps {result.pairs_kept:,} of {result.pairs_total:,} pairs"
    if result.alignments:
        sentence += f"; {certain} of {len(result.alignments)} alignments by the radio are certain"
    tone = "warn" if unsure else "good"
    return {"tone": tone, "sentence": f"{sentence}.", "next": unsure, "notes": list(result.diagnosis)}


def _numbers(result: FilterResult, wireless: WirelessLog) -> list[dict[str, str]]:
    share = f"{significant(100 * result.pairs_kept / result.pairs_total)} %" if result.pairs_total else "none"
    return [
        {"label": "pairs kept", "value": share, "note": f"{result.pairs_kept:,} of {result.pairs_total:,}"},
        {"label": "measurements", "value": f"{len(wireless.measurements):,}"},
        {"label": "time", "value": f"{significant(result.seconds)} s"},
    ]


def _pairs_table(result: FilterResult, trajectories: Mapping[str, Trajectory]) -> dict[str, Any]:
    rows = [
        [f"{p.robot_a} and {p.robot_b}", len(p), len(trajectories[p.robot_a]) * len(trajectories[p.robot_b])]
        for p in result.pairs
    ]
    return {"caption": "Pairs kept", "header": ["robots", "kept", "of"], "rows": rows}
