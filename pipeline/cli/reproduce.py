"""The command `reproduce`: the paper's experiments, beside its tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from wiclosure.pipeline.cli.options import Result, Set, Working, grouped


@grouped
def reproduce(
    experiment: Annotated[str, typer.Argument(help="shell-space (Table II) or kitti08 (Table I)")],
    *,
    seeds: Annotated[int, typer.Option("--seeds", min=1, help="so many worlds")] = 1,
    seed: Annotated[int, typer.Option("--seed", min=0, help="of the first world")] = 0,
    poses: Annotated[
        Path | None, typer.Option("--poses", help="KITTI poses of sequence 08 (kitti08)", show_default=False)
    ] = None,
    n_scans: Annotated[
        int | None, typer.Option("-n", "--n-scans", min=1, help="read only so many scans of each robot")
    ] = None,
    set_: Set = None,
    result: Result,
    working: Working,
) -> None:
    """Run an experiment of the paper without and with the filter, and print its table beside ours.

    For example:

      wiclosure reproduce shell-space --seeds 5

      wiclosure reproduce kitti08 --poses 08.txt
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from wiclosure.pipeline.cli.compare import run_plan
    from wiclosure.pipeline.cli.result_folder import result_folder
    from wiclosure.pipeline.comparison import reproduction as reproducing
    from wiclosure.pipeline.comparison.tables import comparison_json

    chosen, plan = reproducing.plan_of(experiment, poses=poses, seed=seed, seeds=seeds, n_scans=n_scans, set_=set_)
    with result_folder(result, [str(poses)] if poses else []) as (folder, scratch):
        compared = run_plan(plan, scratch, working)
        (scratch / "reproduce.md").write_text(reproducing.report(chosen, compared, n_scans), encoding="utf-8")
    if working.as_json:
        typer.echo(json.dumps(comparison_json(compared), indent=2))
    elif not working.quiet:
        for preset, (header, rows) in reproducing.tables(chosen, compared).items():
            title = f"{chosen.title}; back end {preset}"
            shown = Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
            shown.add_column(header[0], no_wrap=True)
            for column in header[1:]:
                shown.add_column(column.replace(": ", "\n"), justify="right")
            for row in rows:
                shown.add_row(*row)
            Console().print(shown)
        for sentence in (*reproducing.verdicts(compared), *chosen.contradictions):
            Console().print(f"- {sentence}")
        Console().print(f"report, tables and pictures in {folder}")
