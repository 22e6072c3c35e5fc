"""Options that several commands share: each is declared once, in a group, and a command takes whole groups.

Light to import: `wiclosure --help` reads it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_type_hints

import typer

from wiclosure.errors import ConfigError

if TYPE_CHECKING:
    from wiclosure.pipeline.config import Config
    from wiclosure.pipeline.data.inputs import Inputs
    from wiclosure.pipeline.runtime.cache import StageCache
    from wiclosure.pipeline.runtime.progress import Progress
    from wiclosure.workers import Workers

Data = Annotated[
    list[str],
    typer.Argument(
        metavar="DATA...",
        help="a dataset.yaml, recordings named alpha=PATH beta=PATH (bags, KITTI folders, folders of clouds), or"
        " scenario:NAME",
        show_default=False,
    ),
]
_FILTERS = ("wiclosure", "none", "range-gate", "oracle", "random")


def _filters() -> list[str]:
    return list(_FILTERS)


def _presets() -> list[str]:
    from wiclosure.pipeline.presets import preset_names

    return list(preset_names())


FilterName = Annotated[
    str | None,
    typer.Option("--filter", "-f", help=", ".join(_FILTERS), show_default=False, autocompletion=_filters),
]
ConfigName = Annotated[
    str | None,
    typer.Option(
        "--config",
        "-c",
        help="YAML file, or name of a preset (dump-config --presets lists them)",
        show_default=False,
        autocompletion=_presets,
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", help="one setting, e.g. keyframes.distance_m=2; may be repeated", show_default=False),
]
WIRELESS_HELP = (
    "radio log: a file or bag, with settings behind commas where it needs some"
    " (uwb.csv,unit=mm), or a YAML file of them"
)
Wireless = Annotated[
    list[str] | None, typer.Option("--wireless", "-w", metavar="LOG", help=WIRELESS_HELP, show_default=False)
]
AcceptCorrection = Annotated[
    bool,
    typer.Option(
        "--accept-correction",
        help="correct a systematic error of the wireless log that the filter or the merged map finds, and go on",
    ),
]
NewFolder = Annotated[Path, typer.Option("--out", "-o", help="folder of the new data set")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="replace the result if it exists")]
Salvage = Annotated[bool, typer.Option("--salvage", help="read damaged bags as far as possible")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="no progress bars and no table")]
AsJson = Annotated[bool, typer.Option("--json", help="print the figures as JSON instead of a table")]


def with_accepted_correction(set_: list[str] | None, *, accept: bool) -> list[str] | None:
    """Single settings, with that of `--accept-correction`."""
    return [*(set_ or []), "filter.accept_correction=true"] if accept else set_


@dataclass(frozen=True, slots=True)
class Result:
    """Where the results go."""

    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="result folder [default: results/<time>]", show_default=False),
    ] = None
    overwrite: Overwrite = False


@dataclass(frozen=True, slots=True)
class Showing:
    """What the terminal shows."""

    quiet: Quiet = False
    as_json: AsJson = False


@dataclass(frozen=True, slots=True)
class Configuration:
    """What the pipeline is set to."""

    config: ConfigName = None
    set_: Set = None
    seed: Annotated[int | None, typer.Option("--seed", help="seed of the random filter; nothing else is random")] = None
    accept_correction: AcceptCorrection = False

    def resolved(self, *, preset: str | None = None, use_filter: str | None = None) -> Config:
        """The configuration: the file, a preset laid over it, then single settings.

        Raises:
            ConfigError: see `wiclosure.pipeline.config.load_config`.
        """
        from wiclosure.pipeline.config import resolve

        return resolve(
            self.config,
            with_accepted_correction(self.set_, accept=self.accept_correction),
            preset=preset,
            seed=self.seed,
            use_filter=use_filter,
        )


@dataclass(frozen=True, slots=True)
class RecordingOptions:
    """How recordings are read."""

    topic: Annotated[
        str | None,
        typer.Option("--topic", help="PointCloud2 topic; needed only where a bag has several", show_default=False),
    ] = None
    wireless: Wireless = None
    n_scans: Annotated[
        int | None, typer.Option("-n", "--n-scans", min=1, help="read at most this many scans of each robot")
    ] = None
    salvage: Salvage = False

    def inputs(self, data: Sequence[str]) -> Inputs:
        """The recordings and radio logs that `data` names."""
        from wiclosure.pipeline.data.open_inputs import open_inputs

        wireless = self.wireless or ()
        return open_inputs(data, topic=self.topic, wireless=wireless, limit=self.n_scans, salvage=self.salvage)


def _limit_memory(text: str | None) -> str | None:
    """Begins to watch over memory where a limit is given."""
    if text is not None:
        from wiclosure.pipeline.runtime.memory_limit import MemoryLimit, bytes_of

        MemoryLimit(bytes_of(text))
    return text


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Who does the work."""

    jobs: Annotated[
        int,
        typer.Option(
            "-j",
            "--jobs",
            min=1,
            help="number of processes: one per robot for odometry and simulation, further ones read scans ahead; then"
            " pairs of robots, and registrations",
        ),
    ] = 1
    cluster: Annotated[
        str | None,
        typer.Option(
            "--cluster",
            metavar="ADDRESS",
            help="dask scheduler whose workers do the work: tcp://HOST:PORT, tls://HOST:PORT, or local:N to start N"
            " here; all machines must share the cache's folder (simulate, and several seeds: that of --out too)",
            show_default=False,
        ),
    ] = None
    cluster_tls: Annotated[
        str | None,
        typer.Option(
            "--cluster-tls", metavar="CA,CERT,KEY", help="PEM files for a tls:// scheduler", show_default=False
        ),
    ] = None

    @contextmanager
    def on_cluster(self) -> Iterator[Workers | None]:
        """The cluster that is asked for, or None: then `jobs` processes work here.

        Raises:
            ConfigError: see `runtime.cluster.connection.cluster`; or options that do not go together.
        """
        self.require_together()
        if self.cluster is None:
            yield None
            return
        from wiclosure.pipeline.runtime.cluster.connection import TlsFiles, cluster

        tls = None if self.cluster_tls is None else TlsFiles.of_words(self.cluster_tls)
        with cluster(self.cluster, tls) as workers:
            yield workers

    def require_together(self) -> None:
        """Fails for options that do not go together."""
        if self.cluster is None and self.cluster_tls is not None:
            raise ConfigError("--cluster-tls goes with --cluster tls://HOST:PORT")
        if self.cluster is not None and self.jobs > 1:
            raise ConfigError("-j and --cluster are two ways to work side by side; give one of them")


@dataclass(frozen=True, slots=True)
class Working(SideBySide):
    """How the work is done and shown."""

    memory: Annotated[
        str | None,
        typer.Option(
            "--memory",
            metavar="LIMIT",
            callback=_limit_memory,
            help="stop with a sentence when all processes together take more, as 8GB or 75%",
            show_default=False,
        ),
    ] = None
    no_cache: Annotated[bool, typer.Option("--no-cache", help="compute every stage again, and keep no result")] = False
    quiet: Quiet = False
    as_json: AsJson = False

    def require_together(self) -> None:
        """See `SideBySide`; a cluster needs the cache."""
        SideBySide.require_together(self)
        if self.cluster is not None and self.no_cache:
            raise ConfigError("a cluster hands its results over by the cache; leave out --no-cache")

    @property
    def progress(self) -> Progress:
        """Bars, unless quiet."""
        from wiclosure.pipeline.report.progress_bars import BarProgress
        from wiclosure.pipeline.runtime.progress import NoProgress

        return NoProgress() if self.quiet else BarProgress()

    @property
    def cache(self) -> StageCache:
        """Stages of earlier runs."""
        from wiclosure.pipeline.runtime.cache import StageCache, default_cache_folder

        return StageCache(None if self.no_cache else default_cache_folder())


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """Gives a command one option for each field of the groups among its parameters, which is what Typer understands."""
    hints = get_type_hints(command, include_extras=True)
    groups = {name: kind for name, kind in hints.items() if isinstance(kind, type) and is_dataclass(kind)}
    parameters: list[inspect.Parameter] = []
    for name, parameter in inspect.signature(command).parameters.items():
        own = [(name, parameter.default, hints[name])]
        parameters += [
            inspect.Parameter(option, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
            for option, default, kind in (_options(groups[name]) if name in groups else own)
        ]

    @wraps(command)
    def called(**options: object) -> None:
        taken = {
            name: kind(**{option: options.pop(option) for option, _, _ in _options(kind)})
            for name, kind in groups.items()
        }
        command(**options, **taken)

    called.__annotations__ = {}
    called.__dict__["__signature__"] = inspect.Signature(parameters)
    return called


def _options(group: type) -> list[tuple[str, object, object]]:
    """Name, default and annotation of each field of a group."""
    hints = get_type_hints(group, include_extras=True)
    return [(field.name, field.default, hints[field.name]) for field in fields(group)]
