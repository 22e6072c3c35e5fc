"""The command line: typer lives here and nowhere else."""

from typing import TYPE_CHECKING

from wiclosure.lazy import offer

if TYPE_CHECKING:
    from wiclosure.pipeline.cli.commands import app as app
    from wiclosure.pipeline.cli.entry import INTERRUPTED as INTERRUPTED
    from wiclosure.pipeline.cli.entry import main as main
else:
    __getattr__, __dir__, __all__ = offer(
        __name__,
        {"wiclosure.pipeline.cli.commands": "app", "wiclosure.pipeline.cli.entry": "INTERRUPTED main"},
    )
