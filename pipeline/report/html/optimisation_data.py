"""What the page shows of `wiclosure optimize`: paths before and after, closures with reasons, the graph of robots."""

from __future__ import annotations

from collections import Counter
from typing import Any

from wiclosure.display import listed, significant
from wiclosure.pipeline.config import Config, dump_config
from wiclosure.pipeline.evaluation.funnel import MEASURED
from wiclosure.pipeline.report.html.closures_data import closure_rows, stages_with_reasons
from wiclosure.pipeline.report.html.scene_data import Placement, robot_entry
from wiclosure.pipeline.report.html.verdict import counted_noun
from wiclosure.pipeline.report.html.versions import versions
from wiclosure.pipeline.stages.optimising import MergedGraphs
from wiclosure.types import Stage, survivors

_STAGES = (Stage.CONSISTENCY, Stage.ESTIMATE)


def optimisation_data(merged: MergedGraphs, config: Config) -> dict[str, Any]:
    """Everything that the page shows of merged graphs."""
    graph, team = merged.graph, merged.team
    placement = Placement.of(graph.components, graph.trajectories)
    return {
        "name": "optimize",
        "verdict": _verdict(merged),
        "numbers": _numbers(merged),
        "robots": [
            robot_entry(
                number,
                len(graph.trajectories),
                path=path,
                odometry=team.odometry[robot],
                keyframes=path,
                placement=placement,
            )
            for number, (robot, path) in enumerate(graph.trajectories.items())
        ],
        "map": None,
        "map_note": "Robots that no closure connects are drawn beside the others." if graph.unconnected else "",
        "closures": _closures(merged, placement),
        "funnel": _funnel(merged),
        "tables": _tables(merged),
        "config": dump_config(config),
        "versions": versions(),
    }


def _closures(merged: MergedGraphs, placement: Placement) -> list[dict[str, Any]]:
    """With the keyframes' indices and the labels of the files."""
    rows = closure_rows(merged.graph.closures, merged.graph.trajectories, placement)
    for row, edge in zip(rows, merged.team.edges, strict=True):
        for end in ("query", "match"):
            robot, keyframe = row[end]
            row[end] = [robot, int(merged.team.indices[robot][keyframe])]
        row["true"] = None if edge.is_false is None else not edge.is_false
    return rows


def _funnel(merged: MergedGraphs) -> list[dict[str, Any]]:
    closures = merged.graph.closures
    names = {stage: name for name, stage in MEASURED.items()}
    counts = [
        ("read", len(closures)),
        *((names[stage], len(survivors(closures, stage))) for stage in _STAGES),
    ]
    return stages_with_reasons(
        [{"stage": stage, "count": count, "true": None, "false": None} for stage, count in counts], closures
    )


def _verdict(merged: MergedGraphs) -> dict[str, Any]:
    graph = merged.graph
    robots, accepted = len(graph.trajectories), len(graph.accepted)
    joined = f"{accepted} of {counted_noun(len(graph.closures), 'closure')} accepted"
    if len(graph.components) == 1:
        together = "One robot" if robots == 1 else f"All {robots} robots in one frame"
        doubts = list(merged.consistent.doubts)
        sentence = f"{together}; {joined}{'; the map may be wrong' if doubts else ''}."
        tone = "warn" if doubts else "good"
        return {"tone": tone, "sentence": sentence, "next": doubts, "notes": list(merged.diagnosis)}
    groups = "; ".join(listed(component) for component in graph.components)
    steps = [
        "Look below why the closures between the groups were rejected. If there are none, the files hold no edge"
        " between their poses; if covariances are stated too small, raise pcm.max_scale."
    ]
    sentence = f"The robots are not all connected ({groups}); {joined}."
    return {"tone": "bad", "sentence": sentence, "next": steps, "notes": list(merged.diagnosis)}


def _numbers(merged: MergedGraphs) -> list[dict[str, str]]:
    trajectories, closures = merged.graph.trajectories, merged.graph.closures
    poses = sum(map(len, trajectories.values()))
    return [
        {"label": "robots", "value": f"{len(trajectories)}", "note": f"{poses:,} poses"},
        {"label": "closures accepted", "value": f"{len(merged.graph.accepted):,}", "note": f"of {len(closures):,}"},
        {"label": "sigmas taken", "value": f"{significant(merged.consistent.scale)} times", "note": "as in the files"},
        {"label": "time", "value": f"{significant(merged.seconds)} s"},
    ]


def _tables(merged: MergedGraphs) -> list[dict[str, Any]]:
    team = merged.team
    rows = [[u.first, u.second, u.place, u.reason] for u in team.unusable]
    ignored = [[what, count] for what, count in Counter(team.ignored).items()]
    poses = [[robot, len(path), float(path.distance[-1])] for robot, path in merged.graph.trajectories.items()]
    tables: list[dict[str, Any]] = [
        {"caption": "Robots", "header": ["robot", "poses", "path, m"], "rows": poses},
        {"caption": "Edges that cannot be used", "header": ["from", "to", "where", "why"], "rows": rows},
        {"caption": "Lines that are not used", "header": ["kind", "lines"], "rows": ignored},
    ]
    return [table for table in tables if table["rows"]]
