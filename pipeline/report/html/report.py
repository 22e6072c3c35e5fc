"""`report.html` of a run, a comparison, a filter or an optimisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wiclosure.display import listed
from wiclosure.errors import InputError
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.report.html.filter_data import filter_data
from wiclosure.pipeline.report.html.optimisation_data import optimisation_data
from wiclosure.pipeline.report.html.page import PAGE, read_page, write_page
from wiclosure.pipeline.report.html.run_data import run_data
from wiclosure.pipeline.report.html.scene_data import fewer_points
from wiclosure.pipeline.report.html.tables_data import arms_table
from wiclosure.pipeline.stages.optimising import MergedGraphs
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import FilterResult, Trajectory, WirelessLog

COMPARED_POINTS = 500_000
MOST_ARMS = 8


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm of a comparison: its name, and its run folder."""

    name: str
    folder: Path


def write_run_report(folder: Path, result: RunResult) -> None:
    """Writes `report.html` of a run into its folder.

    Raises:
        OutputError: it cannot be written.
    """
    run = run_data(result)
    title = f"{_names(run)}: run with the filter {run['name']}"
    write_page(folder / PAGE, {"kind": "run", "title": title, "runs": [run], "metrics": result.metrics})


def write_filter_report(
    folder: Path, result: FilterResult, trajectories: Mapping[str, Trajectory], wireless: WirelessLog, config: Config
) -> None:
    """Writes `report.html` of a candidate filter into a folder.

    Raises:
        OutputError: it cannot be written.
    """
    data = filter_data(result, trajectories, wireless, config)
    title = f"{_names(data)}: pairs that the filter {result.filter_name} keeps"
    write_page(folder / PAGE, {"kind": "filter", "title": title, "runs": [data]})


def write_optimisation_report(folder: Path, merged: MergedGraphs, config: Config) -> None:
    """Writes `report.html` of merged graphs into their folder.

    Raises:
        OutputError: it cannot be written.
    """
    data = optimisation_data(merged, config)
    write_page(folder / PAGE, {"kind": "optimisation", "title": f"{_names(data)}: merged graphs", "runs": [data]})


def write_comparison_report(folder: Path, summary: dict[str, Any], arms: Sequence[Arm]) -> None:
    """Writes `report.html` of a comparison.

    Args:
        folder: of the comparison.
        summary: `of` (what was compared, for the title), `verdict` and `tables` over all arms and worlds, `look_at`
            (the name of the arm to show first).
        arms: those to look at, at most `MOST_ARMS` of which are taken; the first is what others are compared with.

    Raises:
        InputError: an arm holds no report.
        OutputError: it cannot be written.
    """
    pages = [(arm, read_page(arm.folder / PAGE)) for arm in arms[:MOST_ARMS]]
    most = COMPARED_POINTS // max(len(pages), 1)
    runs = [_thinned(page["runs"][0], arm.name, most) for arm, page in pages]
    report = {
        "kind": "comparison",
        "title": f"{_names(runs[0])}: {summary['of']}",
        "verdict": summary["verdict"],
        "tables": [arms_table([(arm.name, page["metrics"]) for arm, page in pages]), *summary["tables"]],
        "runs": runs,
        "look_at": next((n for n, run in enumerate(runs) if run["name"] == summary.get("look_at")), 0),
    }
    write_page(folder / PAGE, report)


def write_again(folder: Path) -> Path:
    """Writes the page of a finished result again, from the data in it, as this version draws it.

    Returns:
        The page.

    Raises:
        InputError: the folder holds no report.
        OutputError: the page cannot be written.
    """
    page = folder / PAGE
    if not page.exists():
        raise InputError(
            f"{folder} holds no {PAGE}; give a folder that wiclosure run, compare, optimize or filter --plot wrote"
        )
    write_page(page, read_page(page))
    return page


def _thinned(run: dict[str, Any], name: str, most: int) -> dict[str, Any]:
    """The same run under the name of its arm, with at most so many points in its map."""
    entry = fewer_points(run["map"], most)
    note = run["map_note"]
    if entry is not run["map"] and entry is not None:
        note = f"{entry['shown']:,} of the map's {entry['of']:,} points are drawn; the arm's own report shows more."
    return run | {"name": name, "map": entry, "map_note": note}


def _names(run: dict[str, Any]) -> str:
    names = [robot["name"] for robot in run["robots"]]
    if len(names) > 3:
        return f"{names[0]}, {names[1]} and {len(names) - 2} more robots"
    return listed(names)
