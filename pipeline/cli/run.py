"""Commands about one run: run, filter, eval, dump-config.  What is heavy is imported by the command that needs it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.pipeline.cli.options import (
    WIRELESS_HELP,
    AcceptCorrection,
    AsJson,
    ConfigName,
    Configuration,
    Data,
    FilterName,
    Overwrite,
    RecordingOptions,
    Result,
    Set,
    Showing,
    SideBySide,
    Working,
    grouped,
    with_accepted_correction,
)
from wiclosure.pipeline.cli.viewing import Viewing

if TYPE_CHECKING:
    from wiclosure.pipeline.config import Config
    from wiclosure.pipeline.stages.filtering import Report


@grouped
def run(
    data: Data,
    *,
    filter_name: FilterName = None,
    result: Result,
    configuration: Configuration,
    reading: RecordingOptions,
    working: Working,
    viewing: Viewing,
) -> None:
    """Merge the recordings of several robots into one map.

    Odometry and scan contexts, candidate filter, registration, consistency check, one pose graph, one map.

    For example:

      wiclosure run dataset.yaml

      wiclosure run alpha=a.bag beta=b_bag/ --wireless radio.jsonl --filter none --out results/unfiltered
    """
    from wiclosure.pipeline.cli.result_folder import result_folder
    from wiclosure.pipeline.report import illustrations, tables
    from wiclosure.pipeline.report.html.report import write_run_report
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.runtime.processes import local_workers
    from wiclosure.pipeline.stages import run as running
    from wiclosure.pipeline.stages import run_folder

    working.require_together()
    viewing.require_possible(overwrite=result.overwrite)
    config = configuration.resolved(use_filter=filter_name)
    with (
        result_folder(result, data) as (folder, scratch),
        viewing.viewers(folder, scratch, quiet=working.quiet or working.as_json) as viewers,
    ):
        inputs, shown = reading.inputs(data), working.progress  # before workers start, which takes longer
        with working.on_cluster() as cluster, viewers.of("run") as viewer:
            workers = cluster or local_workers(working.jobs)
            chosen = running.candidate_filter(config.use_filter, inputs, config, workers)
            prepared = running.prepare(
                inputs, config, cache=working.cache, jobs=working.jobs, progress=shown, viewer=viewer, cluster=cluster
            )
            found = running.run_stages(prepared, chosen, progress=shown, viewer=viewer)
        run_folder.write_run(scratch, found)
        illustrations.illustrate_run(scratch, found)
        write_run_report(scratch, found)
    if working.as_json:
        typer.echo(json.dumps(found.metrics, indent=2))
    elif not working.quiet:
        show(tables.run_table(found.metrics))
        show(f"results in {folder}")


@dataclass(frozen=True, slots=True)
class FilterFiles:
    """What `wiclosure filter` writes."""

    out: Annotated[Path | None, typer.Option("--out", "-o", help="CSV file of the kept pairs", show_default=False)] = (
        None
    )
    summary: Annotated[
        Path | None, typer.Option("--summary", help="JSON file with alignments and figures", show_default=False)
    ] = None
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="folder for report.html and pictures of links and kept pairs", show_default=False),
    ] = None
    overwrite: Overwrite = False

    @property
    def report(self) -> Report | None:
        """Writes the page, where there are pictures."""
        if self.plot is None:
            return None
        from wiclosure.pipeline.report.html.report import write_filter_report

        return write_filter_report


@dataclass(frozen=True, slots=True)
class FilterChoice:
    """Which filter, and its settings."""

    filter_name: FilterName = None
    config: ConfigName = None
    set_: Set = None
    accept_correction: AcceptCorrection = False

    def resolved(self) -> Config:
        """The configuration that names the filter.

        Raises:
            ConfigError: see `wiclosure.pipeline.config.load_config`.
        """
        from wiclosure.pipeline.config import resolve

        single = with_accepted_correction(self.set_, accept=self.accept_correction)
        return resolve(self.config, single, use_filter=self.filter_name)


@grouped
def filter_command(
    trajectory: Annotated[
        list[str],
        typer.Option(
            "--trajectory", "-t", metavar="NAME=FILE", help="odometry of a robot (TUM file); one for each robot"
        ),
    ],
    wireless: Annotated[list[str], typer.Option("--wireless", "-w", metavar="LOG", help=WIRELESS_HELP)],
    files: FilterFiles,
    *,
    choice: FilterChoice,
    side_by_side: SideBySide,
    showing: Showing,
) -> None:
    """Choose candidate pairs from trajectories and radio alone: the filter as a plug-in for other pipelines.

    For example:

      wiclosure filter -t alpha=a.tum -t beta=b.tum -w radio.jsonl -o candidates.csv
    """
    from wiclosure.formats.filter_summary import filter_summary
    from wiclosure.pipeline.radio.words import sources_of_words
    from wiclosure.pipeline.report.tables import filter_table
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.runtime.log import warnings_on_terminal
    from wiclosure.pipeline.runtime.processes import local_workers
    from wiclosure.pipeline.stages import filtering

    settings = choice.resolved()
    outputs = filtering.Outputs(files.out, files.summary, files.plot, overwrite=files.overwrite)
    with warnings_on_terminal(), side_by_side.on_cluster() as cluster:
        logs = sources_of_words(wireless)
        workers = cluster or local_workers(side_by_side.jobs)
        result = filtering.filter_candidates(
            trajectory, logs, config=settings, outputs=outputs, report=files.report, workers=workers
        )
    if showing.as_json:
        typer.echo(json.dumps(filter_summary(result), indent=2, allow_nan=False))
    elif not showing.quiet:
        show(filter_table(result))


def eval_command(
    folder: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="folder that `wiclosure run` wrote")],
    as_json: AsJson = False,
) -> None:
    """Compare a finished run with ground truth again: joint ATE, ATE per robot, RPE, inter-robot transforms.

    Example: wiclosure eval results/latest
    """
    from wiclosure.pipeline.evaluation.evaluate import evaluate_trajectories
    from wiclosure.pipeline.report.tables import trajectory_table
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.stages.run_folder import read_evaluation_settings, read_metrics, read_trajectories

    components = [component["robots"] for component in read_metrics(folder)["components"]]
    settings = read_evaluation_settings(folder)
    merged, truth = read_trajectories(folder)
    errors = evaluate_trajectories(merged, components, truth, settings)
    if as_json:
        typer.echo(json.dumps(errors, indent=2))
    else:
        show(trajectory_table(errors))


def dump_config_command(
    config: ConfigName = None,
    set_: Set = None,
    presets: Annotated[bool, typer.Option("--presets", help="list the names of the presets instead")] = False,
) -> None:
    """Print the resolved configuration as YAML, every key with its unit and meaning.

    Example: wiclosure dump-config --config small-site --set keyframes.distance_m=2
    """
    from wiclosure.pipeline import config as configuration
    from wiclosure.pipeline.presets import preset_names

    known = "\n".join(preset_names())
    typer.echo(known if presets else configuration.dump_config(configuration.resolve(config, set_)).rstrip())
