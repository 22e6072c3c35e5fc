"""`wiclosure cache`: what earlier runs left for later ones."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.table import Table


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="delete all of them")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON instead of a table")] = False,
) -> None:
    """Show or delete the results of stages that earlier runs kept for later ones.

    The environment says where they are kept (WICLOSURE_CACHE) and how large they may grow in all (WICLOSURE_CACHE_GB).

    Example: wiclosure cache --clear
    """
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.runtime.cache import StageCache, default_cache_folder

    kept = StageCache(default_cache_folder())
    if clear:
        kept.clear()
    stock = kept.stock()
    if as_json:
        content = {"folder": str(kept.folder), "limit_bytes": kept.limit_bytes, "stages": [asdict(s) for s in stock]}
        typer.echo(json.dumps(content, indent=2))
        return
    total = sum(stage.size_bytes for stage in stock)
    table = Table(title=str(kept.folder), title_justify="left", title_style="bold")
    table.add_column("stage")
    table.add_column("entries", justify="right")
    table.add_column("size", justify="right")
    for stage in stock:
        table.add_row(stage.stage, str(stage.entries), _megabytes(stage.size_bytes))
    table.add_section()
    table.add_row("in all", str(sum(stage.entries for stage in stock)), _megabytes(total))
    table.add_row("at most", "", _megabytes(kept.limit_bytes))
    show(table)


def _megabytes(size_bytes: int) -> str:
    return f"{size_bytes / 2**20:.1f} MB"
