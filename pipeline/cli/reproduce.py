"""The command `reproduce`: the paper's experiments, beside its tables."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.pipeline.cli.options import Result, Set, Working, grouped

if TYPE_CHECKING:
    from wiclosure.pipeline.comparison.experiments import Experiment
    from wiclosure.pipeline.comparison.outcomes import Comparison


@dataclass(frozen=True, slots=True)
class Worlds:
    """Where the experiment runs: how often, over which poses, and how far."""

    seeds: Annotated[int, typer.Option("--seeds", min=1, help="number of worlds")] = 1
    seed: Annotated[int, typer.Option("--seed", min=0, help="seed of the first world")] = 0
    poses: Annotated[
        Path | None, typer.Option("--poses", help="KITTI poses of sequence 08 (kitti08)", show_default=False)
    ] = None
    n_scans: Annotated[
        int | None, typer.Option("-n", "--n-scans", min=1, help="read at most this many scans of each robot")
    ] = None


@grouped
def reproduce(
    experiment: Annotated[str, typer.Argument(help="shell-space (Table II) or kitti08 (Table I)")],
    *,
    worlds: Worlds,
    set_: Set = None,
    result: Result,
    working: Working,
) -> None:
    """Run an experiment of the paper without and with the filter, and print its table beside ours.

    For example:

      wiclosure reproduce shell-space --seeds 5

      wiclosure reproduce kitti08 --poses 08.txt
    """
    from wiclosure.pipeline.cli.result_folder import result_folder
    from wiclosure.pipeline.comparison import reproduction as reproducing
    from wiclosure.pipeline.comparison.arms import compare
    from wiclosure.pipeline.comparison.comparison_folder import write_comparison
    from wiclosure.pipeline.comparison.page import write_comparison_page
    from wiclosure.pipeline.comparison.tables import comparison_json

    chosen, plan = reproducing.plan_of(experiment, **asdict(worlds), set_=set_)
    with result_folder(result, [str(worlds.poses)] if worlds.poses else []) as (folder, scratch):
        with working.on_cluster() as cluster:
            compared = compare(
                plan, scratch, cache=working.cache, jobs=working.jobs, progress=working.progress, cluster=cluster
            )
        write_comparison(scratch, compared)
        write_comparison_page(scratch, compared)
        (scratch / "reproduce.md").write_text(
            reproducing.reproduction_report(chosen, compared, worlds.n_scans), encoding="utf-8"
        )
    if working.as_json:
        typer.echo(json.dumps(comparison_json(compared), indent=2))
    elif not working.quiet:
        _show(chosen, compared, folder)


def _show(chosen: Experiment, compared: Comparison, folder: Path) -> None:
    """Tables and sentences for the terminal."""
    from wiclosure.pipeline.cli.comparison_tables import reproduction_table
    from wiclosure.pipeline.comparison.reproduction import tables, verdicts
    from wiclosure.pipeline.report.terminal import show

    for preset, (header, rows) in tables(chosen, compared).items():
        show(reproduction_table(f"{chosen.title}; back end {preset}", header, rows))
    for sentence in (*verdicts(compared), *chosen.contradictions):
        show(f"- {sentence}")
    show(f"report, tables and pictures in {folder}")
