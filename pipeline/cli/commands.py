"""The command line: which commands there are, and how errors end.  A command lives in its own module.

Those modules import nothing heavy, so that `wiclosure --help` is quick; their functions do.
"""

from __future__ import annotations

import os
import shutil
import sys
from typing import Annotated, NoReturn, cast

import typer

from wiclosure import __version__
from wiclosure.blas import one_blas_thread_from_here
from wiclosure.errors import WiclosureError, printable
from wiclosure.pipeline.cli import cache as cache_command
from wiclosure.pipeline.cli import compare as compare_commands
from wiclosure.pipeline.cli import data as data_commands
from wiclosure.pipeline.cli import optimize as optimize_command
from wiclosure.pipeline.cli import radio as radio_commands
from wiclosure.pipeline.cli import report as report_command
from wiclosure.pipeline.cli import reproduce as reproduce_command
from wiclosure.pipeline.cli import run as commands
from wiclosure.pipeline.cli import simulate as simulate_command
from wiclosure.pipeline.runtime.interruption import INTERRUPTED, NOTHING_WRITTEN, Interruption
from wiclosure.pipeline.runtime.memory_limit import MemoryLimit

app = typer.Typer(
    name="wiclosure",
    help="Multi-robot LiDAR SLAM that asks the radio where the robots' paths meet.\n\n"
    "Start with wiclosure demo: it needs no data.",
    epilog="Exit codes: 0 done, 1 refused or failed (one line on standard error says why), 130 interrupted."
    " With NO_COLOR set nothing is coloured; piped, a run says a line for each stage.",
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)

NARROW = 80
"""Columns; in fewer, Typer's tables would cut the names of options."""

app.command("run")(commands.run)
app.command("compare")(compare_commands.compare_command)
app.command("reproduce")(reproduce_command.reproduce)
app.command("demo")(compare_commands.demo)
app.command("filter")(commands.filter_command)
app.command("optimize")(optimize_command.optimize)
app.command("simulate")(simulate_command.simulate)
app.command("init")(data_commands.init)
app.command("split")(data_commands.split)
app.add_typer(radio_commands.radio_app, name="radio")
app.command("eval")(commands.eval_command)
app.command("report")(report_command.report)
app.command("info")(data_commands.info)
app.command("dump-config")(commands.dump_config_command)
app.command("cache")(cache_command.cache)


def _version(show: bool) -> None:
    if show:
        typer.echo(f"wiclosure {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    """Options before the command."""


def run_command() -> None:
    """Runs the command that is named by `sys.argv`; known errors become one line and exit code 1."""
    # Typer brings its own copy of click; the root of click's usage errors is reached through Typer's public one.
    usage_error: type[Exception] = typer.BadParameter.mro()[2]
    _suit_terminal()
    one_blas_thread_from_here()
    try:
        Interruption.at_work = True
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False) or 0
    except usage_error as error:
        _fail(f"{cast('typer.BadParameter', error).format_message()} (see wiclosure --help)")
    except WiclosureError as error:
        _fail(str(error))
    except ImportError:
        if not Interruption.came:
            raise
        code = INTERRUPTED  # modules in C that are interrupted while they load say that they cannot be
    except BrokenPipeError:  # `wiclosure ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as error:
        _fail(f"{error.filename or 'a file'}: {error.strerror or error}")
    if code == INTERRUPTED and MemoryLimit.sentence is not None:
        _fail(MemoryLimit.sentence)
    if code == INTERRUPTED:
        typer.echo(NOTHING_WRITTEN, err=True)
    sys.exit(code)


def _suit_terminal() -> None:
    """Help without colours, or without tables, where the terminal asks for it."""
    if os.environ.get("NO_COLOR"):
        from typer import rich_utils

        rich_utils.COLOR_SYSTEM = None  # without colours it would still write bold
    if shutil.get_terminal_size().columns < NARROW:
        app.rich_markup_mode = radio_commands.radio_app.rich_markup_mode = None


def _fail(message: str) -> NoReturn:
    typer.echo(f"wiclosure: error: {printable(message)}", err=True)
    sys.exit(1)
