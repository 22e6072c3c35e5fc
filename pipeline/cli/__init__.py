"""The command line: typer lives here and nowhere else."""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer
from wiclosure.pipeline.runtime.interruption import INTERRUPTED, Interruption

if TYPE_CHECKING:
    from wiclosure.pipeline.cli.commands import app as app
else:
    __getattr__, __dir__, __all__ = offer(__name__, {"wiclosure.pipeline.cli.commands": "app"})
    __all__ += ["INTERRUPTED", "main"]


def main() -> None:
    """Entry point: known errors become one line and exit code 1; signals are listened to before anything is loaded."""
    Interruption.listen()
    from wiclosure.pipeline.cli.commands import run_command

    run_command()
