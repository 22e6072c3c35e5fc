"""What each command of the command line does; imported only when one runs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import typer
from rich.console import Console

from wiclosure.errors import ConfigError
from wiclosure.pipeline.cache import StageCache, default_cache_folder
from wiclosure.pipeline.config import Config, preset_names, resolve
from wiclosure.pipeline.config import dump_config as config_text
from wiclosure.pipeline.inputs import Inputs, open_inputs
from wiclosure.pipeline.log import json_log, warnings_on_terminal
from wiclosure.pipeline.output import default_folder, point_latest, whole_folder
from wiclosure.pipeline.progress import BarProgress, NoProgress, Progress


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

    with _result_folder(out, overwrite=overwrite) as (folder, scratch):
        inputs = reading.inputs(data)
        prepared = running.prepare(inputs, config, cache=working.cache, jobs=working.jobs, progress=working.progress)
        chosen = prepared.candidate_filter(config.use_filter)
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
    from wiclosure.pipeline import comparison, illustrations, tables
    from wiclosure.pipeline import run as running

    with _result_folder(out, overwrite=overwrite) as (folder, scratch):
        inputs = reading.inputs(data)
        prepared = running.prepare(inputs, config, cache=working.cache, jobs=working.jobs, progress=working.progress)
        compared = comparison.compare(prepared, filters, progress=working.progress)
        comparison.write_comparison(scratch, compared)
        illustrations.illustrate_comparison(scratch, compared)
    if working.as_json:
        typer.echo(json.dumps(compared.metrics, indent=2))
    elif not working.quiet:
        Console().print(tables.comparison_table(compared.metrics))
        Console().print(f"results in {folder}")


@contextmanager
def _result_folder(out: Path | None, *, overwrite: bool) -> Iterator[tuple[Path, Path]]:
    """The folder as it will be, and as it is until then; logs into it, and `latest` points to it at the end."""
    folder = out if out is not None else default_folder()
    with whole_folder(folder, overwrite=overwrite) as scratch, json_log(scratch / "log.jsonl"), warnings_on_terminal():
        yield folder, scratch
    if out is None:
        point_latest(folder)


def demo(*, out: Path | None, overwrite: bool, seed: int, quiet: bool) -> None:
    """`wiclosure demo`: a small world, its bags, and both arms over them."""
    from wiclosure.pipeline.scenario_writer import write_scenario
    from wiclosure.simulation.scenarios import ScenarioSettings, make_scenario

    working = Working(keep=False, quiet=quiet)
    folder = out if out is not None else default_folder()
    with whole_folder(folder, overwrite=overwrite) as scratch:
        (scratch / "data").mkdir()
        scenario = make_scenario("demo-site", ScenarioSettings(seed=seed))
        formats = {"alpha": "ros1", "beta": "ros2-mcap"}
        dataset = write_scenario(scenario, scratch / "data", formats, progress=working.progress)
        compare(
            [str(dataset)],
            filters=["none", "wiclosure"],
            out=scratch / "comparison",
            overwrite=False,
            config=resolve(None, None, seed=seed),
            reading=Reading(),
            working=working,
        )
    if out is None:
        point_latest(folder)
    if not quiet:
        Console().print(f"data set, merged maps and pictures in {folder}")


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
    from wiclosure.pipeline.run_folder import read_metrics, read_trajectories
    from wiclosure.pipeline.tables import trajectory_table

    components = [component["robots"] for component in read_metrics(folder)["components"]]
    config = resolve(str(folder / "config.yaml"), None)
    merged, truth = read_trajectories(folder)
    errors = evaluate_trajectories(merged, components, truth, config.evaluation)
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


def show_map(path: Path) -> None:
    """A window with the merged map.

    Raises:
        ConfigError: there is no screen.
    """
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ConfigError(f"there is no screen to show the map on; open {path} elsewhere")
    import open3d as o3d

    o3d.visualization.draw_geometries([o3d.io.read_point_cloud(path)], window_name=str(path))
