"""Commands that make or inspect data: init, split, info."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.pipeline.cli.options import AsJson, NewFolder, Overwrite, Salvage, grouped

if TYPE_CHECKING:
    from wiclosure.pipeline.data.dataset import Dataset
    from wiclosure.types import WirelessLog


@dataclass(frozen=True, slots=True)
class Parts:
    """What each robot has of the drive."""

    sequence: Annotated[
        str | None, typer.Option("--sequence", help="name of the sequence, for example 08", show_default=False)
    ] = None
    robots: Annotated[int, typer.Option("--robots", min=2, help="number of robots")] = 3
    overlap: Annotated[
        float, typer.Option("--overlap", min=0, max=0.99, help="share of each part that the next robot drives as well")
    ] = 0.0


@dataclass(frozen=True, slots=True)
class SimulatedRadio:
    """What the robots measure of each other."""

    radio: Annotated[bool, typer.Option(help="simulate a wireless log from the poses")] = True
    seed: Annotated[int, typer.Option("--seed", help="seed of the simulated radio")] = 0


@grouped
def split(
    kitti: Annotated[Path, typer.Argument(metavar="KITTI_DIR", help="folder of the KITTI odometry data set")],
    out: NewFolder,
    *,
    parts: Parts,
    radio: SimulatedRadio,
    overwrite: Overwrite = False,
) -> None:
    """Make a multi-robot data set of one KITTI sequence: contiguous parts that start together.

    Example: wiclosure split ~/kitti --sequence 08 --robots 3 --out data/kitti08
    """
    from wiclosure.pipeline.data.split import find_sequence, split_kitti
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.runtime.log import warnings_on_terminal
    from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses

    def heard(dataset: Dataset) -> WirelessLog:
        truth = {robot: dataset.ground_truth(robot) for robot in dataset.robots}
        known = {robot: trajectory for robot, trajectory in truth.items() if trajectory is not None}
        return simulate_wireless_from_poses(known, RadioSettings(), radio.seed)

    with warnings_on_terminal():
        drive = find_sequence(kitti, parts.sequence)
        log = heard if radio.radio else None
        split_kitti(drive, parts.robots, out, overlap=parts.overlap, heard=log, overwrite=overwrite)
    show(f"data set of {parts.robots} robots in {out}; merge it with: wiclosure run {out}")


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="folder with recordings, radio logs, trajectories")],
    salvage: Salvage = False,
    overwrite: Overwrite = False,
) -> None:
    """Write a commented dataset.yaml from what a folder holds; what is guessed is marked.

    Example: wiclosure init ~/data/site, then wiclosure run ~/data/site
    """
    from wiclosure.errors import OutputError
    from wiclosure.pipeline.data.dataset_file import DATASET_FILE
    from wiclosure.pipeline.data.folders.draft import GUESS, draft_dataset
    from wiclosure.pipeline.data.folders.survey import survey
    from wiclosure.pipeline.runtime.log import warnings_on_terminal
    from wiclosure.pipeline.runtime.output import whole_file

    target = folder / DATASET_FILE
    if target.exists() and not overwrite:
        raise OutputError(f"{target} exists already; edit it, or write a new one with --overwrite")
    with warnings_on_terminal():
        text = draft_dataset(folder, survey(folder, salvage=salvage))
    with whole_file(target) as scratch:
        scratch.write_text(text, encoding="utf-8")
    typer.echo(text, nl=False)
    guesses = sum(GUESS in line for line in text.splitlines()[1:])
    guessed = "1 line is a guess: look at it" if guesses == 1 else f"{guesses} lines are guesses: look at them"
    marked = guessed if guesses else "nothing in it is guessed"
    if waiting := sum(": NAME" in line and "# -" in line for line in text.splitlines()):
        marked += f"; {waiting} radio logs are left out until you name the robots of their ids"
    typer.echo(f"written to {target}; {marked}. Merge it with: wiclosure run {folder}")


def info(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="PATH", help="a bag, folder of scans, radio log or dataset.yaml, or a folder of all that"
        ),
    ],
    salvage: Salvage = False,
    as_json: AsJson = False,
) -> None:
    """Show what a recording, data set, radio log or folder of them holds, and what of it a run would use.

    Of a recording: topics, types, counts, duration, point fields.

    Example: wiclosure info ~/data/site
    """
    from wiclosure.pipeline.data.folders.overview import overview, recording_overview
    from wiclosure.pipeline.report.tables import overview_table, recording_table
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.runtime.log import warnings_on_terminal

    with warnings_on_terminal():
        entries = overview(path, salvage=salvage)
        recording = None if entries else recording_overview(path, salvage=salvage)
    if as_json:
        content = [asdict(entry) for entry in entries] if recording is None else asdict(recording)
        typer.echo(json.dumps(content, indent=2, default=str))
    else:
        show(overview_table(path, entries) if recording is None else recording_table(recording))
