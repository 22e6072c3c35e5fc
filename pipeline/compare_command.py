"""Commands that compare filters: compare, demo."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.pipeline.options import Configuration, Data, Quiet, Reading, Result, Working, grouped

if TYPE_CHECKING:
    from wiclosure.pipeline.comparison import Comparison
    from wiclosure.pipeline.config import Config


@grouped
def compare(
    data: Data,
    *,
    filters: Annotated[str, typer.Option("--filters", help="comma-separated names; the first is the base")] = (
        "none,wiclosure"
    ),
    result: Result,
    configuration: Configuration,
    reading: Reading,
    working: Working,
) -> None:
    """Run the same recordings with different filters, over shared odometry, descriptors and registrations (A/B).

    For example:

      wiclosure compare dataset.yaml

      wiclosure compare dataset.yaml --filters none,wiclosure,range-gate,oracle,random
    """
    from wiclosure.pipeline.result_folder import result_folder

    names = [name.strip() for name in filters.split(",") if name.strip()]
    config = configuration.resolved()
    with result_folder(result, data) as (folder, scratch):
        compared = _compared(data, scratch, filters=names, config=config, reading=reading, working=working)
    _show(compared, folder, working)


@grouped
def demo(
    result: Result,
    seed: Annotated[int, typer.Option("--seed", help="another world")] = 0,
    quiet: Quiet = False,
) -> None:
    """Simulate two robots, write their bags, and merge them with the wireless filter off and on.  Needs no data."""
    from wiclosure.pipeline.config import resolve
    from wiclosure.pipeline.result_folder import result_folder
    from wiclosure.pipeline.scenario_writer import write_scenario
    from wiclosure.simulation.scenarios import ScenarioSettings, make_scenario

    working = Working(no_cache=True, quiet=quiet)
    with result_folder(result) as (folder, scratch):
        scenario = make_scenario("demo-site", ScenarioSettings(seed=seed))
        (scratch / "data").mkdir()
        formats = {"alpha": "ros1", "beta": "ros2-mcap"}
        dataset = write_scenario(scenario, scratch / "data", formats, progress=working.progress)
        compared = _compared(
            [str(dataset)],
            scratch,
            filters=["none", "wiclosure"],
            config=resolve("small-site", None, seed=seed),
            reading=Reading(),
            working=working,
        )
    _show(compared, folder, working)


def _compared(
    data: Sequence[str],
    folder: Path,
    *,
    filters: Sequence[str],
    config: Config,
    reading: Reading,
    working: Working,
) -> Comparison:
    """Runs every filter over the data and writes all into `folder`."""
    from wiclosure.pipeline import comparison, illustrations
    from wiclosure.pipeline import run as running

    inputs = reading.inputs(data)
    chosen = comparison.filters_named(filters, inputs, config)
    prepared = running.prepare(inputs, config, cache=working.cache, jobs=working.jobs, progress=working.progress)
    compared = comparison.compare(prepared, chosen, progress=working.progress)
    comparison.write_comparison(folder, compared)
    illustrations.illustrate_comparison(folder, compared)
    return compared


def _show(compared: Comparison, folder: Path, working: Working) -> None:
    from rich.console import Console

    from wiclosure.pipeline import tables

    if working.as_json:
        typer.echo(json.dumps(compared.metrics, indent=2))
    elif not working.quiet:
        Console().print(tables.comparison_table(compared.metrics))
        Console().print(f"merged maps and pictures in {folder}")
