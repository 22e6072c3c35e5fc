"""Commands that compare arms: compare, demo."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.pipeline.cli.options import Configuration, Data, Quiet, Reading, Result, Working, grouped

if TYPE_CHECKING:
    from wiclosure.pipeline.comparison.arms import Comparison, Plan


@grouped
def compare(
    data: Data,
    *,
    filters: Annotated[str, typer.Option("--filters", help="comma-separated names; the first is the base")] = (
        "none,wiclosure"
    ),
    presets: Annotated[
        str | None,
        typer.Option(
            "--presets", help="comma-separated presets or YAML files, each laid over --config", show_default=False
        ),
    ] = None,
    seeds: Annotated[
        int, typer.Option("--seeds", min=1, help="so many worlds of a scenario, or draws of the random filter")
    ] = 1,
    result: Result,
    configuration: Configuration,
    reading: Reading,
    working: Working,
) -> None:
    """Run the same recordings with different filters and presets, over shared odometry and registrations (A/B).

    For example:

      wiclosure compare dataset.yaml

      wiclosure compare scenario:shell-space --config small-site --presets strong,disco-park --seeds 5

      wiclosure compare dataset.yaml --filters none,wiclosure,range-gate,oracle,random
    """
    from wiclosure.pipeline.cli.result_folder import result_folder
    from wiclosure.pipeline.comparison.plan import make_plan

    plan = make_plan(data, filters, presets, seeds, configuration=configuration, reading=reading)
    with result_folder(result, data) as (folder, scratch):
        compared = run_plan(plan, scratch, working)
    _show(compared, folder, working)


@grouped
def demo(
    result: Result,
    seed: Annotated[int, typer.Option("--seed", help="another world")] = 0,
    quiet: Quiet = False,
) -> None:
    """Simulate two robots, write their bags, and merge them with the wireless filter off and on.  Needs no data."""
    from wiclosure.pipeline.cli.result_folder import result_folder
    from wiclosure.pipeline.comparison.plan import make_plan
    from wiclosure.pipeline.data.scenario_writer import write_scenario
    from wiclosure.simulation.scenarios import ScenarioSettings, make_scenario

    working = Working(no_cache=True, quiet=quiet)
    with result_folder(result) as (folder, scratch):
        scenario = make_scenario("demo-site", ScenarioSettings(seed=seed))
        (scratch / "data").mkdir()
        formats = {"alpha": "ros1", "beta": "ros2-mcap"}
        dataset = write_scenario(scenario, scratch / "data", formats, progress=working.progress)
        settings = Configuration(config="small-site", seed=seed)
        plan = make_plan([str(dataset)], "none,wiclosure", configuration=settings, reading=Reading())
        compared = run_plan(plan, scratch, working)
    _show(compared, folder, working)


def run_plan(plan: Plan, folder: Path, working: Working) -> Comparison:
    """Runs every arm and writes all into `folder`."""
    from wiclosure.pipeline.comparison import arms as comparison
    from wiclosure.pipeline.comparison import pictures as comparison_pictures
    from wiclosure.pipeline.comparison import tables as comparison_tables

    compared = comparison.compare(plan, folder, cache=working.cache, jobs=working.jobs, progress=working.progress)
    comparison_tables.write_tables(folder, compared)
    comparison_pictures.draw_errors(folder / "ate.png", compared)
    comparison_pictures.draw_funnel(folder / "funnel.png", compared)
    return compared


def _show(compared: Comparison, folder: Path, working: Working) -> None:
    from rich.console import Console

    from wiclosure.pipeline.comparison import tables as comparison_tables

    if working.as_json:
        typer.echo(json.dumps(comparison_tables.comparison_json(compared), indent=2))
    elif not working.quiet:
        Console().print(comparison_tables.comparison_table(compared))
        for remark in compared.plan.remarks:
            Console().print(remark)
        Console().print(f"merged maps, tables and pictures in {folder}")
