"""The command line.  Says what there is and hands over; everything heavy is imported by the command that needs it."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Annotated, NoReturn, cast

import typer

from wiclosure import __version__
from wiclosure.errors import WiclosureError

app = typer.Typer(
    name="wiclosure",
    help="Multi-robot LiDAR SLAM that asks the radio where the robots' paths meet.\n\n"
    "Start with [bold]wiclosure demo[/bold]: it needs no data.",
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)

INTERRUPTED = 130
"""What Typer makes of Ctrl-C, as shells do: 128 and the signal's number."""

Data = Annotated[
    list[str],
    typer.Argument(
        metavar="DATA...",
        help="a dataset.yaml, or recordings named alpha=PATH beta=PATH (bags, KITTI folders, folders of clouds)",
        show_default=False,
    ),
]
Out = Annotated[
    Path | None,
    typer.Option("--out", "-o", help="result folder [default: results/<time>]", show_default=False),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="replace the result folder if it exists")]
ConfigName = Annotated[
    str | None,
    typer.Option("--config", "-c", help="YAML file or preset name (see dump-config)", show_default=False),
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", help="one setting, e.g. keyframes.distance_m=2; may be repeated", show_default=False),
]
Topic = Annotated[
    str | None,
    typer.Option("--topic", help="PointCloud2 topic; guessed when a bag has only one", show_default=False),
]
Wireless = Annotated[
    list[Path] | None,
    typer.Option("--wireless", "-w", help="wireless log (JSON Lines), besides those of the data set"),
]
FilterName = Annotated[
    str | None,
    typer.Option("--filter", "-f", help="wiclosure, none, range-gate, oracle, random", show_default=False),
]
Scans = Annotated[int | None, typer.Option("-n", "--n-scans", min=1, help="read only so many scans of each robot")]
Jobs = Annotated[int, typer.Option("-j", "--jobs", min=1, help="processes for odometry, one robot each")]
Seed = Annotated[int | None, typer.Option("--seed", help="seed of the random filter; nothing else is random")]
Salvage = Annotated[bool, typer.Option("--salvage", help="use what can be read of damaged bags")]
NoCache = Annotated[bool, typer.Option("--no-cache", help="compute every stage anew, and keep none")]
Visualise = Annotated[bool, typer.Option("-v", "--visualize", help="show the merged map in a window at the end")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="no progress, no table")]
Json = Annotated[bool, typer.Option("--json", help="print the metrics as JSON instead of a table")]


@app.command()
def run(
    data: Data,
    filter_name: FilterName = None,
    out: Out = None,
    overwrite: Overwrite = False,
    config: ConfigName = None,
    set_: Set = None,
    topic: Topic = None,
    wireless: Wireless = None,
    n_scans: Scans = None,
    jobs: Jobs = 1,
    seed: Seed = None,
    salvage: Salvage = False,
    no_cache: NoCache = False,
    visualise: Visualise = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Merge the recordings of several robots into one map.

    Odometry and scan contexts, candidate filter, registration, consistency check, one pose graph, one map.

    For example:

      wiclosure run dataset.yaml

      wiclosure run alpha=a.bag beta=b_bag/ --wireless radio.jsonl --filter none --out results/unfiltered
    """
    from wiclosure.pipeline import commands
    from wiclosure.pipeline.config import resolve

    commands.run(
        data,
        out=out,
        overwrite=overwrite,
        config=resolve(config, set_, seed=seed, use_filter=filter_name),
        reading=commands.Reading(topic, tuple(wireless or ()), n_scans, salvage),
        working=commands.Working(jobs, keep=not no_cache, quiet=quiet, as_json=as_json),
        visualise=visualise,
    )


@app.command()
def compare(
    data: Data,
    filters: Annotated[str, typer.Option("--filters", help="comma-separated names; the first is the base")] = (
        "none,wiclosure"
    ),
    out: Out = None,
    overwrite: Overwrite = False,
    config: ConfigName = None,
    set_: Set = None,
    topic: Topic = None,
    wireless: Wireless = None,
    n_scans: Scans = None,
    jobs: Jobs = 1,
    seed: Seed = None,
    salvage: Salvage = False,
    no_cache: NoCache = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Run the same recordings with different filters, over shared odometry, descriptors and registrations (A/B).

    For example:

      wiclosure compare dataset.yaml

      wiclosure compare dataset.yaml --filters none,wiclosure,range-gate,oracle,random
    """
    from wiclosure.pipeline import commands
    from wiclosure.pipeline.config import resolve

    commands.compare(
        data,
        filters=[name.strip() for name in filters.split(",") if name.strip()],
        out=out,
        overwrite=overwrite,
        config=resolve(config, set_, seed=seed),
        reading=commands.Reading(topic, tuple(wireless or ()), n_scans, salvage),
        working=commands.Working(jobs, keep=not no_cache, quiet=quiet, as_json=as_json),
    )


@app.command()
def demo(
    out: Out = None,
    overwrite: Overwrite = False,
    seed: Annotated[int, typer.Option("--seed", help="another world")] = 0,
    quiet: Quiet = False,
) -> None:
    """Simulate two robots, write their bags, and merge them with the wireless filter off and on.  Needs no data."""
    from wiclosure.pipeline import commands

    commands.demo(out=out, overwrite=overwrite, seed=seed, quiet=quiet)


@app.command("filter")
def filter_(
    trajectory: Annotated[
        list[str],
        typer.Option("--trajectory", "-t", metavar="NAME=FILE", help="odometry of a robot (TUM); one for each robot"),
    ],
    wireless: Annotated[list[Path], typer.Option("--wireless", "-w", help="wireless log (JSON Lines), or a bag")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="kept pairs as CSV", show_default=False)] = None,
    summary: Annotated[
        Path | None, typer.Option("--summary", help="alignments and figures as JSON", show_default=False)
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="folder for pictures of what the filter did", show_default=False)
    ] = None,
    filter_name: FilterName = None,
    config: ConfigName = None,
    set_: Set = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace files that exist")] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Choose candidate pairs from trajectories and radio alone: the filter as a plug-in for other pipelines.

    For example:

      wiclosure filter -t alpha=a.tum -t beta=b.tum -w radio.jsonl -o candidates.csv
    """
    from wiclosure.pipeline import filtering
    from wiclosure.pipeline.config import resolve

    filtering.filter_candidates(
        trajectory,
        wireless,
        config=resolve(config, set_, use_filter=filter_name),
        outputs=filtering.Outputs(out, summary, plot, overwrite=overwrite),
        quiet=quiet,
        as_json=as_json,
    )


@app.command()
def simulate(
    scenario: Annotated[str, typer.Argument(help="demo-site, shell-space, city, kitti08, campus, static-mirror")],
    out: Annotated[Path, typer.Option("--out", "-o", help="folder of the new data set")],
    robots: Annotated[int | None, typer.Option("--robots", help="how many", show_default=False)] = None,
    lidar: Annotated[
        str | None, typer.Option("--lidar", help="hdl64, vlp16, vlp32, os1-64, generic-32", show_default=False)
    ] = None,
    aliasing: Annotated[
        float | None, typer.Option("--aliasing", help="0: every place is unique; 1: all are alike", show_default=False)
    ] = None,
    poses: Annotated[
        Path | None, typer.Option("--poses", help="KITTI poses to build streets along (kitti08)", show_default=False)
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="another seed, another world")] = 0,
    recording_format: Annotated[
        str, typer.Option("--format", help="ros1, ros2-mcap, ros2-sqlite3, kitti")
    ] = "ros2-mcap",
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Write a simulated data set: recordings, wireless log, ground truth, dataset.yaml.

    Example: wiclosure simulate shell-space --out data/shell
    """
    from wiclosure.pipeline import commands

    choice = {"robots": robots, "lidar": lidar, "aliasing": aliasing, "poses": poses, "seed": seed}
    commands.simulate(scenario, choice, out=out, recording_format=recording_format, overwrite=overwrite, quiet=quiet)


@app.command()
def split(
    kitti: Annotated[Path, typer.Argument(metavar="KITTI_DIR", help="folder of the KITTI odometry data set")],
    out: Annotated[Path, typer.Option("--out", "-o", help="folder of the new data set")],
    sequence: Annotated[str | None, typer.Option("--sequence", help="for example 08", show_default=False)] = None,
    robots: Annotated[int, typer.Option("--robots", min=2, help="how many robots")] = 3,
    overlap: Annotated[
        float, typer.Option("--overlap", min=0, max=0.99, help="share of each part that the next robot drives as well")
    ] = 0.0,
    radio: Annotated[bool, typer.Option(help="simulate a wireless log from the poses")] = True,
    seed: Annotated[int, typer.Option("--seed", help="seed of the simulated radio")] = 0,
    overwrite: Overwrite = False,
) -> None:
    """Make a multi-robot data set of one KITTI sequence: contiguous parts that start together.

    Example: wiclosure split ~/kitti --sequence 08 --robots 3 --out data/kitti08
    """
    from wiclosure.pipeline import commands

    commands.split(
        kitti, sequence=sequence, robots=robots, out=out, overlap=overlap, radio=radio, seed=seed, overwrite=overwrite
    )


@app.command("eval")
def evaluate(
    folder: Annotated[Path, typer.Argument(metavar="RUN_DIR", help="folder that `wiclosure run` wrote")],
    as_json: Json = False,
) -> None:
    """Compare a finished run with ground truth again: joint ATE, ATE a robot, RPE, inter-robot transforms."""
    from wiclosure.pipeline import commands

    commands.evaluate(folder, as_json=as_json)


@app.command()
def info(
    path: Annotated[Path, typer.Argument(metavar="BAG", help="a bag, KITTI folder or folder of clouds")],
    salvage: Salvage = False,
    as_json: Json = False,
) -> None:
    """Show what a recording holds: topics, types, counts, duration, point fields."""
    from wiclosure.pipeline import commands

    commands.info(path, salvage=salvage, as_json=as_json)


@app.command("dump-config")
def dump_config(
    config: ConfigName = None,
    set_: Set = None,
    presets: Annotated[bool, typer.Option("--presets", help="list the names of the presets instead")] = False,
) -> None:
    """Print the resolved configuration as YAML, every key with its unit and meaning."""
    from wiclosure.pipeline import commands

    commands.dump_config(config, set_, presets=presets)


def _version(show: bool) -> None:
    if show:
        typer.echo(f"wiclosure {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    """Options before the command."""


def main() -> None:
    """Entry point: known errors become one line and exit code 1."""
    # Typer brings its own copy of click; the root of click's usage errors is reached through Typer's public one.
    usage_error: type[Exception] = typer.BadParameter.mro()[2]
    # Matrices here are small: more BLAS threads than one only wait for each other, up to five times longer in all.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False) or 0
    except usage_error as error:
        _fail(f"{cast('typer.BadParameter', error).format_message()} (see wiclosure --help)")
    except WiclosureError as error:
        _fail(str(error))
    except BrokenPipeError:  # `wiclosure ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 0
    except OSError as error:
        _fail(f"{error.filename or 'a file'}: {error.strerror or error}")
    if code == INTERRUPTED:
        typer.echo("interrupted: nothing is written; finished odometry is kept, unless with --no-cache", err=True)
    sys.exit(code)


def _fail(message: str) -> NoReturn:
    typer.echo(f"wiclosure: error: {' '.join(message.split())}", err=True)
    sys.exit(1)


if __name__ == "__main__":
    main()
