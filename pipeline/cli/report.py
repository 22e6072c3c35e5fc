"""The command `report`: the page of a finished run, made again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def report(
    folder: Annotated[
        Path, typer.Argument(metavar="RUN_DIR", help="folder that `wiclosure run`, `compare` or `demo` wrote")
    ],
) -> None:
    """Make report.html of a finished run or comparison again: one page that needs no network.

    Example: wiclosure report results/latest
    """
    from wiclosure.pipeline.report.html.report import write_again

    typer.echo(f"report in {write_again(folder)}")
