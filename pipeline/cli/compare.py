"""Commands that compare arms: compare, demo."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.errors import ConfigError
from wiclosure.pipeline.cli.options import Configuration, Data, Quiet, RecordingOptions, Result, Working, grouped
from wiclosure.pipeline.cli.viewing import Viewers, Viewing

if TYPE_CHECKING:
    from wiclosure.pipeline.comparison.outcomes import Comparison
    from wiclosure.pipeline.comparison.plan import Plan


@dataclass(frozen=True, slots=True)
class Arms:
    """What is compared."""

    filters: Annotated[
        str, typer.Option("--filters", help="comma-separated names; the others are compared with the first")
    ] = "none,wiclosure"
    presets: Annotated[
        str | None,
        typer.Option(
            "--presets", help="comma-separated presets or YAML files, each laid over --config", show_default=False
        ),
    ] = None
    seeds: Annotated[
        int,
        typer.Option(
            "--seeds", min=1, help="number of worlds of a scenario, or of draws of the random filter over recordings"
        ),
    ] = 1


@grouped
def compare_command(
    data: Data,
    *,
    arms: Arms,
    result: Result,
    configuration: Configuration,
    reading: RecordingOptions,
    working: Working,
    viewing: Viewing,
) -> None:
    """Run the same recordings with different filters and presets, over shared odometry and registrations (A/B).

    For example:

      wiclosure compare dataset.yaml

      wiclosure compare scenario:shell-space --config small-site --presets strong,disco-park --seeds 5

      wiclosure compare dataset.yaml --filters none,wiclosure,range-gate,oracle,random
    """
    from wiclosure.pipeline.cli.result_folder import result_folder

    viewing.require_possible(overwrite=result.overwrite, several=True)
    plan = make_plan(data, arms.filters, arms.presets, arms.seeds, configuration=configuration, reading=reading)
    with (
        result_folder(result, data) as (folder, scratch),
        viewing.viewers(folder, scratch, quiet=working.quiet or working.as_json) as viewers,
    ):
        compared = _compared(plan, scratch, working, viewers)
    _show(compared, folder, working)


@grouped
def demo(
    result: Result,
    viewing: Viewing,
    seed: Annotated[int, typer.Option("--seed", help="each seed gives another world")] = 0,
    quiet: Quiet = False,
) -> None:
    """Simulate two robots, write their bags, and merge them with the wireless filter off and on.  Needs no data.

    Example: wiclosure demo --out results/demo
    """
    from wiclosure.pipeline.cli.result_folder import result_folder
    from wiclosure.pipeline.data.scenarios.scenario_writer import write_scenario
    from wiclosure.simulation.scenarios.registry import ScenarioSettings, make_scenario

    viewing.require_possible(overwrite=result.overwrite, several=True)
    working = Working(no_cache=True, quiet=quiet)
    with result_folder(result) as (folder, scratch), viewing.viewers(folder, scratch, quiet=quiet) as viewers:
        scenario = make_scenario("demo-site", ScenarioSettings(seed=seed))
        (scratch / "data").mkdir()
        formats = {"alpha": "ros1", "beta": "ros2-mcap"}
        dataset = write_scenario(scenario, scratch / "data", formats, progress=working.progress)
        settings = Configuration(config="small-site", seed=seed)
        plan = make_plan([str(dataset)], "none,wiclosure", configuration=settings, reading=RecordingOptions())
        compared = _compared(plan, scratch, working, viewers)
    _show(compared, folder, working)


def make_plan(
    data: Sequence[str],
    filters: str,
    presets: str | None = None,
    seeds: int = 1,
    *,
    configuration: Configuration,
    reading: RecordingOptions,
) -> Plan:
    """What these words ask to compare, checked before any work.

    Args:
        data: words that name recordings, or one scenario.
        filters: comma-separated names.
        presets: comma-separated presets or YAML files; None: the configuration alone.
        seeds: worlds of a scenario, or draws of the random filter over recordings.
        configuration: what the presets are laid over.
        reading: how recordings are read.

    Raises:
        ConfigError: an unknown filter or preset (with the nearest name), one named twice, or none.
    """
    from wiclosure.pipeline.comparison.plan import Plan, recorded_worlds, require_each_once, scenario_worlds
    from wiclosure.pipeline.data.scenarios.scenario_source import PREFIX, read_scenario_word

    sources: Sequence[str | None] = _words(presets or "") or [None]
    names = [Path(source or configuration.config or "default").stem for source in sources]
    require_each_once("preset", names)
    configs = {name: configuration.resolved(preset=source) for name, source in zip(names, sources, strict=True)}
    chosen = tuple(_words(filters))
    if not any(word.startswith(PREFIX) for word in data):
        inputs = partial(reading.inputs, data)
        return Plan(configs, chosen, *recorded_worlds(inputs, chosen, seeds, configuration.seed or 0))
    if configuration.seed is not None:
        raise ConfigError("--seed: the seed of a scenario is named with it, for example scenario:city,seed=3")
    reading.inputs(data)  # refuses what cannot be read beside a scenario
    name, settings = read_scenario_word(data[0])
    return Plan(configs, chosen, scenario_worlds(name, settings, seeds, reading.n_scans))


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _compared(plan: Plan, folder: Path, working: Working, viewers: Viewers) -> Comparison:
    """Runs every arm and writes all into `folder`."""
    from wiclosure.pipeline.comparison import arms
    from wiclosure.pipeline.comparison.comparison_folder import write_comparison
    from wiclosure.pipeline.comparison.page import write_comparison_page

    viewed = partial(viewers.of, several=True)
    with working.on_cluster() as cluster:
        compared = arms.compare(
            plan,
            folder,
            cache=working.cache,
            jobs=working.jobs,
            progress=working.progress,
            viewed=viewed,
            apart=not viewers.recording,
            cluster=cluster,
        )
    write_comparison(folder, compared)
    write_comparison_page(folder, compared)
    return compared


def _show(compared: Comparison, folder: Path, working: Working) -> None:
    from wiclosure.pipeline.cli.comparison_tables import comparison_table, starts_table
    from wiclosure.pipeline.comparison.starts import has_truth
    from wiclosure.pipeline.comparison.tables import comparison_json
    from wiclosure.pipeline.report.terminal import show

    if working.as_json:
        typer.echo(json.dumps(comparison_json(compared), indent=2))
    elif not working.quiet:
        show(comparison_table(compared))
        if not has_truth(compared):
            show(starts_table(compared))
        for remark in compared.plan.remarks:
            show(remark)
        show(f"merged maps, tables and pictures in {folder}")
