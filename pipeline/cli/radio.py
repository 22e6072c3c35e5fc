"""`wiclosure radio`: what a radio log holds, the log as JSON Lines, and whether it fits the robots' trajectories."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.pipeline.cli.options import WIRELESS_HELP, AsJson, Overwrite, Salvage

if TYPE_CHECKING:
    from collections.abc import Sequence

    from wiclosure.pipeline.radio.read import RadioReading

radio_app = typer.Typer(
    help="Radio logs of any origin: what they hold, as JSON Lines, and whether they fit the robots' trajectories.",
    no_args_is_help=True,
)

Log = Annotated[str, typer.Argument(metavar="LOG", help=WIRELESS_HELP)]
Trajectories = Annotated[
    list[str] | None,
    typer.Option("--trajectory", "-t", metavar="NAME=FILE", help="odometry of a robot (TUM); one for each robot"),
]


@radio_app.command("info")
def radio_info(
    log: Annotated[str | None, typer.Argument(metavar="LOG", help=WIRELESS_HELP)] = None,
    robots: Annotated[
        str | None, typer.Option("--robots", help="names of the robots, with commas between", show_default=False)
    ] = None,
    presets: Annotated[bool, typer.Option("--presets", help="list the presets instead")] = False,
    salvage: Salvage = False,
    as_json: AsJson = False,
) -> None:
    """Show what a radio log holds: pairs, ranges, bearings, times, and what is left out of it and why.

    Example: wiclosure radio info uwb.csv,unit=mm,robots.7=alpha,robots.12=beta
    """
    from wiclosure.pipeline.radio import presets as known_presets
    from wiclosure.pipeline.radio.summary import pair_summaries
    from wiclosure.pipeline.report.radio_tables import presets_table, radio_table
    from wiclosure.pipeline.report.terminal import show

    if presets:
        show(presets_table(known_presets.presets()))
        return
    if log is None:
        raise typer.BadParameter("name a log, or ask for --presets")
    for reading in _readings([log], robots, salvage=salvage):
        if as_json:
            pairs = [asdict(pair) for pair in pair_summaries(reading.log)]
            left = [] if reading.account is None else reading.account.sentences()
            unused = [radio.sentence(()) for radio in reading.unused]
            found = {"kind": reading.kind, "pairs": pairs, "left_out": left, "unused": unused}
            typer.echo(json.dumps(found, indent=2))
        else:
            show(radio_table(reading))
            for radio in reading.unused:
                typer.echo(radio.sentence(()))


@radio_app.command()
def convert(
    log: Log,
    out: Annotated[Path, typer.Option("--out", "-o", help="wireless log (JSON Lines) to write")],
    robots: Annotated[
        str | None, typer.Option("--robots", help="names of the robots, with commas between", show_default=False)
    ] = None,
    salvage: Salvage = False,
    overwrite: Overwrite = False,
) -> None:
    """Write a radio log of any kind as JSON Lines; reading it again gives the same measurements.

    Example: wiclosure radio convert team_bag,preset=tiers --robots turtle02,turtle03 --out wireless.jsonl
    """
    from wiclosure.errors import OutputError
    from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
    from wiclosure.pipeline.runtime.output import whole_file
    from wiclosure.types import WirelessLog

    if out.exists() and not overwrite:
        raise OutputError(f"{out} exists already; choose another name, or replace it with --overwrite")
    whole = sum((reading.log for reading in _readings([log], robots, salvage=salvage)), WirelessLog())
    with whole_file(out) as scratch:
        write_wireless_log(scratch, whole)
    typer.echo(f"{len(whole.measurements)} measurements, {len(whole.headings)} headings in {out}")


@radio_app.command()
def messages(out: Annotated[Path, typer.Option("--out", "-o", help="folder of a workspace's sources")]) -> None:
    """Write the ROS 2 package wiclosure_msgs, to build and to publish radio measurements with.

    Example: wiclosure radio messages --out ~/ros2_ws/src
    """
    from wiclosure.pipeline.sources.messages.message_package import write_message_package

    target = write_message_package(out)
    typer.echo(f"written to {target}; build it with: colcon build --packages-select wiclosure_msgs")


@radio_app.command()
def check(
    data: Annotated[
        list[str] | None,
        typer.Argument(metavar="[DATA]...", help="data set whose radio is checked against its own odometry or truth"),
    ] = None,
    wireless: Annotated[
        list[str] | None, typer.Option("--wireless", "-w", metavar="LOG", help=WIRELESS_HELP, show_default=False)
    ] = None,
    trajectory: Trajectories = None,
    salvage: Salvage = False,
    as_json: AsJson = False,
) -> None:
    """Hold a radio log against trajectories: units, clock, gaps, axes; what is suspected, and the key that corrects it.

    Trajectories are odometry of any frame, as `wiclosure run` writes it (NAME_odometry.tum), or the truth.

    Example: wiclosure radio check -w uwb.csv -t alpha=alpha.tum -t beta=beta.tum
    """
    from wiclosure.pipeline.data.radio_check import log_and_trajectories
    from wiclosure.pipeline.radio.check.check import check_log
    from wiclosure.pipeline.radio.words import sources_of_words
    from wiclosure.pipeline.report.radio_tables import check_table
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.runtime.log import warnings_on_terminal

    with warnings_on_terminal():
        sources = sources_of_words(wireless or ())
        log, paths, read_alike = log_and_trajectories(data or (), sources, trajectory or (), salvage=salvage)
        result = check_log(log, paths, read_alike)
    if as_json:
        found = [asdict(finding) for finding in result.findings]
        typer.echo(json.dumps({"settings": dict(result.settings), "findings": found}, indent=2))
    else:
        show(check_table(result))


def _readings(words: Sequence[str], robots: str | None, *, salvage: bool = False) -> list[RadioReading]:
    from wiclosure.pipeline.radio.read import read_radio
    from wiclosure.pipeline.radio.words import sources_of_words
    from wiclosure.pipeline.runtime.log import warnings_on_terminal

    known = None if robots is None else [name.strip() for name in robots.split(",") if name.strip()]
    with warnings_on_terminal():
        return [read_radio(source, known, salvage=salvage) for source in sources_of_words(words)]
