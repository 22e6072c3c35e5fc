"""The command `report`: the page of a finished run, made again, and the run for other viewers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wiclosure.pipeline.cli.options import Overwrite


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="RUN_DIR", help="folder that `wiclosure run`, `compare` or `demo` wrote")
    ],
    mcap: Annotated[
        Path | None,
        typer.Option(
            "--mcap",
            metavar="FILE",
            help="write the run as ROS 2 messages for Foxglove or RViz instead: map, paths, transforms, closures",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Make report.html of a finished run or comparison again: one page that needs no network.

    Example: wiclosure report results/latest
    """
    if mcap is not None:
        from wiclosure.pipeline.report.foxglove import write_mcap

        write_mcap(folder, mcap, overwrite=overwrite)
        typer.echo(f"map, paths and closures in {mcap}")
        return
    from wiclosure.pipeline.report.html.report import write_again

    typer.echo(f"report in {write_again(folder)}")
