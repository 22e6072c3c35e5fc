"""What each command of the command line does; imported only when one runs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from pydantic import ValidationError
from rich.console import Console

from wiclosure.errors import ConfigError
from wiclosure.pipeline.cache import StageCache, default_cache_folder
from wiclosure.pipeline.config import Config, preset_names, resolve
from wiclosure.pipeline.config import dump_config as config_text
from wiclosure.pipeline.inputs import Inputs, open_inputs
from wiclosure.pipeline.log import json_log, warnings_on_terminal
from wiclosure.pipeline.output import default_folder, point_latest, require_apart, whole_folder
from wiclosure.pipeline.progress import BarProgress, NoProgress, Progress

if TYPE_CHECKING:
    from wiclosure.pipeline.comparison import Comparison


@dataclass(frozen=True, slots=True)
class Reading:
    """How recordings are read."""

    topic: str | None = None
    wireless: tuple[Path, ...] = ()
    n_scans: int | None = None
    salvage: bool = False

    def inputs(self, data: Sequence[str]) -> Inputs:
        """The recordings and radio logs that `data` names."""
        return open_inputs(data, topic=self.topic, wireless=self.wireless, limit=self.n_scans, salvage=self.salvage)


@dataclass(frozen=True, slots=True)
class Working:
    """How the work is done and shown."""

    jobs: int = 1
    keep: bool = True
    quiet: bool = False
    as_json: bool = False

    @property
    def progress(self) -> Progress:
        """Bars, unless quiet."""
        return NoProgress() if self.quiet else BarProgress()

    @property
    def cache(self) -> StageCache:
        """Stages of earlier runs."""
        return StageCache(default_cache_folder() if self.keep else None)


def run(
    data: Sequence[str],
    *,
    out: Path | None,
    overwrite: bool,
    config: Config,
    reading: Reading,
    working: Working,
    visualise: bool,
) -> None:
    """`wiclosure run`."""
    from wiclosure.pipeline import illustrations, run_folder, tables
    from wiclosure.pipeline import run as running

    if visualise:
        require_screen()
    with _result_folder(out, overwrite=overwrite, data=data) as (folder, scratch):
        inputs = reading.inputs(data)
        chosen = running.candidate_filter(config.use_filter, inputs, config)
        prepared = running.prepare(inputs, config, cache=working.cache, jobs=working.jobs, progress=working.progress)
        result = running.run(prepared, chosen, progress=working.progress)
        run_folder.write_run(scratch, result)
        illustrations.illustrate_run(scratch, result)
    if working.as_json:
        typer.echo(json.dumps(result.metrics, indent=2))
    elif not working.quiet:
        Console().print(tables.run_table(result.metrics))
        Console().print(f"results in {folder}")
    if visualise:
        show_map(folder / "map.ply")


def compare(
    data: Sequence[str],
    *,
    filters: Sequence[str],
    out: Path | None,
    overwrite: bool,
    config: Config,
    reading: Reading,
    working: Working,
) -> None:
    """`wiclosure compare`."""
    with _result_folder(out, overwrite=overwrite, data=data) as (folder, scratch):
        compared = _compared(data, scratch, filters=filters, config=config, reading=reading, working=working)
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
    from wiclosure.pipeline import tables

    if working.as_json:
        typer.echo(json.dumps(compared.metrics, indent=2))
    elif not working.quiet:
        Console().print(tables.comparison_table(compared.metrics))
        Console().print(f"merged maps and pictures in {folder}")


@contextmanager
def _result_folder(out: Path | None, *, overwrite: bool, data: Sequence[str] = ()) -> Iterator[tuple[Path, Path]]:
    """The folder as it will be, and as it is until then; logs into it, and `latest` points to it at the end."""
    folder = out if out is not None else default_folder()
    require_apart(folder, (Path(word.partition("=")[2] or word) for word in data))
    with whole_folder(folder, overwrite=overwrite) as scratch, json_log(scratch / "log.jsonl"), warnings_on_terminal():
        yield folder, scratch
    if out is None:
        point_latest(folder)


def demo(*, out: Path | None, overwrite: bool, seed: int, quiet: bool) -> None:
    """`wiclosure demo`: a small world, its bags, and both arms over them."""
    from wiclosure.pipeline.scenario_writer import write_scenario
    from wiclosure.simulation.scenarios import ScenarioSettings, make_scenario

    working = Working(keep=False, quiet=quiet)
    with _result_folder(out, overwrite=overwrite) as (folder, scratch):
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


def simulate(
    name: str, choice: Mapping[str, object], *, out: Path, recording_format: str, overwrite: bool, quiet: bool
) -> None:
    """`wiclosure simulate`: a scenario written as a user would bring it."""
    from wiclosure.pipeline.scenario_writer import require_format, write_scenario
    from wiclosure.simulation.scenarios import ScenarioSettings, make_scenario

    require_format(recording_format)
    try:
        settings = ScenarioSettings.model_validate({key: value for key, value in choice.items() if value is not None})
    except ValidationError as error:
        problem = error.errors()[0]
        option = str(problem["loc"][0]).replace("_", "-")
        raise ConfigError(f"--{option} {problem['input']}: {problem['msg'].lower()}") from None
    progress = Working(quiet=quiet).progress
    with whole_folder(out, overwrite=overwrite) as scratch, warnings_on_terminal():
        scenario = make_scenario(name, settings)
        write_scenario(scenario, scratch, dict.fromkeys(scenario.robots, recording_format), progress=progress)
    if not quiet:
        Console().print(f"{len(scenario.robots)} robots in {out}; merge them with: wiclosure run {out}")


def split(
    kitti: Path,
    *,
    sequence: str | None,
    robots: int,
    out: Path,
    overlap: float,
    radio: bool,
    seed: int,
    overwrite: bool,
) -> None:
    """`wiclosure split`: a KITTI sequence as a data set of several robots."""
    from wiclosure.pipeline.dataset import Dataset
    from wiclosure.pipeline.split import split_kitti
    from wiclosure.simulation.radio import RadioSettings, simulate_wireless_from_poses
    from wiclosure.types import WirelessLog

    def heard(dataset: Dataset) -> WirelessLog:
        truth = {robot: dataset.ground_truth(robot) for robot in dataset.robots}
        known = {robot: trajectory for robot, trajectory in truth.items() if trajectory is not None}
        return simulate_wireless_from_poses(known, RadioSettings(), seed)

    with warnings_on_terminal():
        split_kitti(kitti, sequence, robots, out, overlap=overlap, heard=heard if radio else None, overwrite=overwrite)
    Console().print(f"data set of {robots} robots in {out}; merge it with: wiclosure run {out}")


def evaluate(folder: Path, *, as_json: bool) -> None:
    """`wiclosure eval`."""
    from wiclosure.pipeline.evaluation import evaluate_trajectories
    from wiclosure.pipeline.run_folder import read_evaluation_settings, read_metrics, read_trajectories
    from wiclosure.pipeline.tables import trajectory_table

    components = [component["robots"] for component in read_metrics(folder)["components"]]
    settings = read_evaluation_settings(folder)
    merged, truth = read_trajectories(folder)
    errors = evaluate_trajectories(merged, components, truth, settings)
    if as_json:
        typer.echo(json.dumps(errors, indent=2))
    else:
        Console().print(trajectory_table(errors))


def info(path: Path, *, salvage: bool, as_json: bool) -> None:
    """`wiclosure info`."""
    from wiclosure.pipeline.sources.info import recording_info
    from wiclosure.pipeline.tables import recording_table

    found = recording_info(path, salvage=salvage)
    if as_json:
        typer.echo(json.dumps(asdict(found), indent=2, default=str))
    else:
        Console().print(recording_table(found))


def dump_config(source: str | None, overrides: Sequence[str] | None, *, presets: bool) -> None:
    """`wiclosure dump-config`."""
    typer.echo("\n".join(preset_names()) if presets else config_text(resolve(source, overrides)).rstrip())


def require_screen() -> None:
    """Fails where no window can be opened.

    Raises:
        ConfigError: there is no screen.
    """
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ConfigError("there is no screen for --visualize; leave it out, and open the result's map.ply elsewhere")


def show_map(path: Path) -> None:
    """A window with the merged map."""
    import open3d as o3d

    o3d.visualization.draw_geometries([o3d.io.read_point_cloud(path)], window_name=str(path))
