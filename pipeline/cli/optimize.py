"""`wiclosure optimize`: the back end alone, on pose graphs of any origin."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from wiclosure.pipeline.cli.options import ConfigName, Json, Quiet, Result, Set, grouped


@grouped
def optimize(
    graphs: Annotated[
        list[Path],
        typer.Argument(
            metavar="GRAPH.g2o...", help="pose graphs (SE3:QUAT), one or several files; GTSAM's symbols name the robots"
        ),
    ],
    *,
    config: ConfigName = None,
    set_: Set = None,
    quiet: Quiet = False,
    as_json: Json = False,
    result: Result,
) -> None:
    """Merge several robots' pose graphs, false closures or not: consistency check, then robust estimate.

    Writes graph.g2o with the fate of every closure, <robot>.tum and <robot>_kitti.txt, closures.csv, summary.json.

    For example:

      wiclosure optimize alpha.g2o beta.g2o --out results/merged

      wiclosure optimize graph.g2o --set pcm.probability=0.95 --set pose_graph.anchor=b
    """
    from rich.console import Console

    from wiclosure.pipeline.cli.result_folder import result_folder
    from wiclosure.pipeline.config import resolve
    from wiclosure.pipeline.stages import optimising as optimizing

    settings = resolve(config, set_)
    with result_folder(result, list(map(str, graphs))) as (folder, scratch):
        merged = optimizing.merge(graphs, settings)
        optimizing.write(scratch, merged)
    if as_json:
        typer.echo(json.dumps(optimizing.summary(merged), indent=2, allow_nan=False))
    elif not quiet:
        for table in optimizing.tables(merged):
            Console().print(table)
        Console().print(f"merged graph and trajectories in {folder}")
