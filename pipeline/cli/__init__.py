"""The command line: typer lives here and nowhere else."""

from wiclosure.pipeline.cli.commands import INTERRUPTED, app, main

__all__ = ["INTERRUPTED", "app", "main"]
