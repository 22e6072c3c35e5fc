"""`wiclosure optimize`: the back end alone, on pose graphs of any origin."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from wiclosure.pipeline.cli.options import ConfigName, Result, Set, Showing, grouped


@grouped
def optimize(
    graphs: Annotated[
        list[Path],
        typer.Argument(
            metavar="GRAPH...",
            help="pose graphs, one or several files: g2o, Toro (.xz, .gz, .bz2, .zst too), JSON Robot Log (.jrl)",
        ),
    ],
    *,
    config: ConfigName = None,
    set_: Set = None,
    showing: Showing,
    result: Result,
) -> None:
    """Merge several robots' pose graphs, false closures or not: consistency check, then robust estimate.

    A robot is what its own edges connect: GTSAM's symbols name robots, and where numbers are plain, edges tell them.

    Writes graph.g2o with the fate of every closure, <robot>.tum and <robot>_kitti.txt, closures.csv, summary.json,
    config.yaml, report.html, and results.jrr for a JSON Robot Log.

    For example:

      wiclosure optimize alpha.g2o beta.g2o --out results/merged

      wiclosure optimize graph.g2o --set pcm.probability=0.95 --set pose_graph.anchor=b
    """
    from wiclosure.pipeline.cli.result_folder import result_folder
    from wiclosure.pipeline.config import dump_config, resolve
    from wiclosure.pipeline.report.html.report import write_optimisation_report
    from wiclosure.pipeline.report.merged_tables import merged_tables
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.stages.merged_folder import summary, write_merged
    from wiclosure.pipeline.stages.optimising import merge_graphs

    settings = resolve(config, set_)
    with result_folder(result, list(map(str, graphs))) as (folder, scratch):
        merged = merge_graphs(graphs, settings)
        write_merged(scratch, merged)
        (scratch / "config.yaml").write_text(dump_config(settings), encoding="utf-8")
        write_optimisation_report(scratch, merged, settings)
    if showing.as_json:
        typer.echo(json.dumps(summary(merged), indent=2, allow_nan=False))
    elif not showing.quiet:
        for table in merged_tables(summary(merged)):
            show(table)
        show(f"merged graph and trajectories in {folder}")
