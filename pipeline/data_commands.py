"""Commands that make or inspect data: simulate, split, info."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.errors import ConfigError
from wiclosure.pipeline.options import Json, Overwrite, Quiet, Salvage, Working

if TYPE_CHECKING:
    from wiclosure.pipeline.dataset import Dataset
    from wiclosure.types import WirelessLog

NewFolder = Annotated[Path, typer.Option("--out", "-o", help="folder of the new data set")]


def simulate(
    scenario: Annotated[str, typer.Argument(help="demo-site, shell-space, city, kitti08, campus, static-mirror")],
    out: NewFolder,
    robots: Annotated[int | None, typer.Option("--robots", help="how many", show_default=False)] = None,
    lidar: Annotated[
        str | None, typer.Option("--lidar", help="hdl64, vlp16, vlp32, os1-64, generic-32", show_default=False)
    ] = None,
    aliasing: Annotated[
        float | None, typer.Option("--aliasing", help="0: every place is unique; 1: all are alike", show_default=False)
    ] = None,
    poses: Annotated[
        Path | None, typer.Option("--poses", help="KITTI poses to build streets along (kitti08)", show_default=False)
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="another seed, another world")] = 0,
    recording_format: Annotated[
        str, typer.Option("--format", help="ros1, ros2-mcap, ros2-sqlite3, kitti")
    ] = "ros2-mcap",
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write a simulated data set: recordings, wireless log, ground truth, dataset.yaml.

    Example: wiclosure simulate shell-space --out data/shell
    """
    from pydantic import ValidationError
    from rich.console import Console

    from wiclosure.pipeline.log import warnings_on_terminal
    from wiclosure.pipeline.output import whole_folder
    from wiclosure.pipeline.scenario_writer import require_format, write_scenario
    from wiclosure.simulation.scenarios import ScenarioSettings, make_scenario

    require_format(recording_format)
    choice = {"robots": robots, "lidar": lidar, "aliasing": aliasing, "poses": poses, "seed": seed}
    try:
        settings = ScenarioSettings.model_validate({key: value for key, value in choice.items() if value is not None})
    except ValidationError as error:
        problem = error.errors()[0]
        option = str(problem["loc"][0]).replace("_", "-")
        raise ConfigError(f"--{option} {problem['input']}: {problem['msg'].lower()}") from None
    progress = Working(quiet=quiet).progress
    with whole_folder(out, overwrite=overwrite) as scratch, warnings_on_terminal():
        world = make_scenario(scenario, settings)
        write_scenario(world, scratch, dict.fromkeys(world.robots, recording_format), progress=progress)
    if not quiet:
        Console().print(f"{len(world.robots)} robots in {out}; merge them with: wiclosure run {out}")


def split(
    kitti: Annotated[Path, typer.Argument(metavar="KITTI_DIR", help="folder of the KITTI odometry data set")],
    out: NewFolder,
    sequence: Annotated[str | None, typer.Option("--sequence", help="for example 08", show_default=False)] = None,
    robots: Annotated[int, typer.Option("--robots", min=2, help="how many robots")] = 3,
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

    from wiclosure.pipeline.log import warnings_on_terminal
    from wiclosure.pipeline.split import split_kitti
    from wiclosure.simulation.radio import RadioSettings, simulate_wireless_from_poses

    def heard(dataset: Dataset) -> WirelessLog:
        truth = {robot: dataset.ground_truth(robot) for robot in dataset.robots}
        known = {robot: trajectory for robot, trajectory in truth.items() if trajectory is not None}
        return simulate_wireless_from_poses(known, RadioSettings(), seed)

    with warnings_on_terminal():
        split_kitti(kitti, sequence, robots, out, overlap=overlap, heard=heard if radio else None, overwrite=overwrite)
    Console().print(f"data set of {robots} robots in {out}; merge it with: wiclosure run {out}")


def info(
    path: Annotated[Path, typer.Argument(metavar="BAG", help="a bag, KITTI folder or folder of clouds")],
    salvage: Salvage = False,
    as_json: Json = False,
) -> None:
    """Show what a recording holds: topics, types, counts, duration, point fields."""
    from rich.console import Console

    from wiclosure.pipeline.sources.info import recording_info
    from wiclosure.pipeline.tables import recording_table

    found = recording_info(path, salvage=salvage)
    if as_json:
        typer.echo(json.dumps(asdict(found), indent=2, default=str))
    else:
        Console().print(recording_table(found))
