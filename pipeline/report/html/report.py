"""`report.html` of a run or a comparison, and the data that it is made of again."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wiclosure.errors import InputError
from wiclosure.pipeline.report.html.packing import packed, unpacked
from wiclosure.pipeline.report.html.page import write_page
from wiclosure.pipeline.report.html.run_data import MAP_POINTS, run_data
from wiclosure.pipeline.report.html.verdict import compared, headline_numbers, verdict
from wiclosure.pipeline.stages.run import RunResult

PAGE = "report.html"
DATA = "report_data.json"


def write_run_report(folder: Path, result: RunResult) -> None:
    """Writes `report.html` and `report_data.json` of a run.

    Raises:
        OutputError: they cannot be written.
    """
    data = run_data(result, result.solution.filtered.filter_name)
    (folder / DATA).write_text(json.dumps(data, allow_nan=False, separators=(",", ":")), encoding="utf-8")
    _write(folder / PAGE, [data])


def write_comparison_report(folder: Path, arms: Sequence[Path]) -> None:
    """Writes `report.html` of a comparison.

    Args:
        folder: of the comparison.
        arms: run folders of the arms to show, below it; the first is what the others are compared with.

    Raises:
        InputError: an arm holds no report data.
        OutputError: it cannot be written.
    """
    most = MAP_POINTS // max(len(arms), 1)
    _write(folder / PAGE, [_with_map_of(_read(arm), most) for arm in arms])


def write_again(folder: Path) -> Path:
    """Makes the report of a finished run or comparison again.

    Returns:
        The page.

    Raises:
        InputError: the folder holds no run of this version.
        OutputError: the page cannot be written.
    """
    if (folder / DATA).exists():
        _write(folder / PAGE, [_read(folder)])
    else:
        arms = sorted(path.parent for path in folder.glob(f"*/{DATA}")) or sorted(
            path.parent for path in folder.rglob(DATA)
        )
        if not arms:
            raise InputError(
                f"{folder} holds no {DATA}; give a folder that wiclosure run, compare or demo of this version wrote"
            )
        arms.sort(key=lambda arm: arm.name != "none")
        write_comparison_report(folder, arms)
    return folder / PAGE


def _read(folder: Path) -> dict[str, Any]:
    path = folder / DATA
    try:
        data: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON ({error}); run again") from error
    if "metrics" not in data or "robots" not in data:
        raise InputError(f"{path} does not hold the data of a report; run again")
    return data


def _with_map_of(run: dict[str, Any], most: int) -> dict[str, Any]:
    """The same run with at most so many points in its map; neighbours in the list are neighbours in space."""
    shown = run["map"]
    if shown is None or shown["shown"] <= most:
        return run
    step = -(-shown["shown"] // most)
    thinned = {name: packed(unpacked(shown[name])[::step]) for name in ("xyz", "robot")}
    count = thinned["robot"]["shape"][0]
    note = f"{count:,} of the map's {shown['of']:,} points are drawn; map.ply holds all."
    return run | {"map": shown | thinned | {"shown": count}, "map_note": note}


def _write(path: Path, runs: Sequence[dict[str, Any]]) -> None:
    """The page of one run, or of several side by side; the last is what the verdict is of."""
    metrics = runs[-1]["metrics"]
    robots = " and ".join(robot["name"] for robot in runs[-1]["robots"][:4])
    report = {
        "verdict": verdict(metrics),
        "numbers": headline_numbers(metrics),
        "comparison": compared([(run["name"], run["metrics"]) for run in runs]) if len(runs) > 1 else None,
        "runs": list(runs),
    }
    write_page(path, f"wiclosure: {robots}", report)
