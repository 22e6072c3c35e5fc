"""Commands that make or inspect data: split, info."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.pipeline.cli.options import Json, NewFolder, Overwrite, Salvage

if TYPE_CHECKING:
    from wiclosure.pipeline.data.dataset import Dataset
    from wiclosure.types import WirelessLog


def split(
    kitti: Annotated[Path, typer.Argument(metavar="KITTI_DIR", help="folder of the KITTI odometry data set")],
    out: NewFolder,
    sequence: Annotated[
        str | None, typer.Option("--sequence", help="name of the sequence, for example 08", show_default=False)
    ] = None,
    robots: Annotated[int, typer.Option("--robots", min=2, help="number of robots")] = 3,
    overlap: Annotated[
        float, typer.Option("--overlap", min=0, max=0.99, help="share of each part that the next robot drives as well")
    ] = 0.0,
    radio: Annotated[bool, typer.Option(help="simulate a wireless log from the poses")] = True,
    seed: Annotated[int, typer.Option("--seed", help="seed of the simulated radio")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Make a multi-robot data set of one KITTI sequence: contiguous parts that start together.

    Example: wiclosure split ~/kitti --sequence 08 --robots 3 --out data/kitti08
    """
    from rich.console import Console

    from wiclosure.pipeline.data.split import split_kitti
    from wiclosure.pipeline.runtime.log import warnings_on_terminal
    from wiclosure.simulation.radio import RadioSettings, simulate_wireless_from_poses

    def heard(dataset: Dataset) -> WirelessLog:
        truth = {robot: dataset.ground_truth(robot) for robot in dataset.robots}
        known = {robot: trajectory for robot, trajectory in truth.items() if trajectory is not None}
        return simulate_wireless_from_poses(known, RadioSettings(), seed)

    with warnings_on_terminal():
        split_kitti(kitti, sequence, robots, out, overlap=overlap, heard=heard if radio else None, overwrite=overwrite)
    Console().print(f"data set of {robots} robots in {out}; merge it with: wiclosure run {out}")


def info(
    path: Annotated[Path, typer.Argument(metavar="BAG", help="a bag, KITTI folder or folder of point clouds")],
    salvage: Salvage = False,
    as_json: Json = False,
) -> None:
    """Show what a recording holds: topics, types, counts, duration, point fields."""
    from rich.console import Console

    from wiclosure.pipeline.report.tables import recording_table
    from wiclosure.pipeline.sources.info import recording_info

    found = recording_info(path, salvage=salvage)
    if as_json:
        typer.echo(json.dumps(asdict(found), indent=2, default=str))
    else:
        Console().print(recording_table(found))
