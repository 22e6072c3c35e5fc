"""The command `simulate`: a scenario written as a user would bring it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from wiclosure.pipeline.cli.options import NewFolder, Overwrite, Quiet, SideBySide, Working, grouped


@dataclass(frozen=True, slots=True)
class ScenarioOptions:
    """What is chosen about a scenario; None leaves the scenario's own value."""

    robots: Annotated[int | None, typer.Option("--robots", help="number of robots", show_default=False)] = None
    lidar: Annotated[
        str | None, typer.Option("--lidar", help="hdl64, vlp16, vlp32, os1-64, generic-32", show_default=False)
    ] = None
    aliasing: Annotated[
        float | None,
        typer.Option("--aliasing", min=0, max=1, help="0: every place is unique; 1: all are alike", show_default=False),
    ] = None
    poses: Annotated[
        Path | None, typer.Option("--poses", help="KITTI poses to build streets along (kitti08)", show_default=False)
    ] = None
    seed: Annotated[int, typer.Option("--seed", min=0, help="each seed gives another world")] = 0
    radio_every_m: Annotated[
        float | None,
        typer.Option(
            "--radio-every-m", help="metres that the receiving robot travels between measurements", show_default=False
        ),
    ] = None
    radio_reach_m: Annotated[
        float | None,
        typer.Option(
            "--radio-reach-m",
            help="greatest distance in metres at which a transmission is received",
            show_default=False,
        ),
    ] = None
    radio_dropout: Annotated[
        float | None,
        typer.Option("--radio-dropout", min=0, max=1, help="share of transmissions lost", show_default=False),
    ] = None
    direct_absent: Annotated[
        float | None,
        typer.Option(
            "--direct-absent", min=0, max=1, help="share of profiles without the direct path", show_default=False
        ),
    ] = None
    reciprocal: Annotated[
        bool | None,
        typer.Option(
            "--reciprocal/--one-way", help="both robots of a link receive, or only the first", show_default=False
        ),
    ] = None
    schedule: Annotated[
        Path | None,
        typer.Option(
            "--schedule",
            help="CSV of the times at which robots can communicate: start_s,end_s and, if wanted, robot_a,robot_b",
            show_default=False,
        ),
    ] = None
    heading_sigma_deg: Annotated[
        float | None,
        typer.Option(
            "--heading-deg", min=0, help="standard deviation of the heading sensor in degrees", show_default=False
        ),
    ] = None
    no_headings: Annotated[bool, typer.Option("--no-headings", help="robots have no heading sensor")] = False
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="any other setting, e.g. radio.paths=3; may be repeated")
    ] = None

    def words(self) -> list[str]:
        """The choice as `key=value`, as in `scenario:NAME,key=value`."""
        chosen = {
            "robots": self.robots,
            "lidar": self.lidar,
            "aliasing": self.aliasing,
            "poses": self.poses,
            "seed": self.seed,
            "schedule": self.schedule,
            "radio.every_m": self.radio_every_m,
            "radio.max_range_m": self.radio_reach_m,
            "radio.dropout": self.radio_dropout,
            "radio.direct_absent": self.direct_absent,
            "radio.direct_absent_blocked": self.direct_absent,
            "radio.direction": {True: "reciprocal", False: "one-way", None: None}[self.reciprocal],
            "radio.heading_sigma_deg": self.heading_sigma_deg,
        }
        words = [f"{key}={json.dumps(value, default=str)}" for key, value in chosen.items() if value is not None]
        return [*words, *(["radio.heading_sigma_deg=null"] if self.no_headings else []), *(self.set_ or [])]


@grouped
def simulate(
    scenario: Annotated[str, typer.Argument(help="demo-site, shell-space, city, kitti08, campus, static-mirror")],
    out: NewFolder,
    options: ScenarioOptions,
    side_by_side: SideBySide,
    recording_format: Annotated[
        str, typer.Option("--format", help="ros1, ros2-mcap, ros2-sqlite3, kitti")
    ] = "ros2-mcap",
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write a simulated data set: recordings, wireless log, ground truth, dataset.yaml, plan.png.

    Without the disk: wiclosure run scenario:NAME

    Example: wiclosure simulate shell-space --out data/shell
    """
    from wiclosure.pipeline.data.scenarios.scenario_source import scenario_settings
    from wiclosure.pipeline.data.scenarios.scenario_writer import require_format, write_scenario
    from wiclosure.pipeline.report.plan_view import draw_plan
    from wiclosure.pipeline.report.terminal import show
    from wiclosure.pipeline.runtime.log import warnings_on_terminal
    from wiclosure.pipeline.runtime.output import whole_folder
    from wiclosure.pipeline.runtime.processes import local_workers
    from wiclosure.simulation.scenarios.registry import make_scenario

    require_format(recording_format)
    with warnings_on_terminal(), side_by_side.on_cluster() as cluster:
        made = make_scenario(scenario, scenario_settings(options.words(), f"simulate {scenario}"))
        with whole_folder(out, overwrite=overwrite) as scratch:
            formats = dict.fromkeys(made.robots, recording_format)
            workers = cluster or local_workers(side_by_side.jobs)
            write_scenario(made, scratch, formats, progress=Working(quiet=quiet).progress, workers=workers)
            draw_plan(made, scratch / "plan.png")
    if not quiet:
        show(f"{len(made.robots)} robots in {out}; merge them with: wiclosure run {out}")
