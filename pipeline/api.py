"""A run from Python, in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import ValidationError

from wiclosure.blas import one_blas_thread
from wiclosure.errors import ConfigError
from wiclosure.interfaces import CandidateFilter
from wiclosure.pipeline.config import Config, load_config
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.report.progress_bars import BarProgress
from wiclosure.pipeline.runtime.cache import StageCache, default_cache_folder
from wiclosure.pipeline.runtime.progress import CallbackProgress, NoProgress, Progress
from wiclosure.pipeline.runtime.settings_text import explain
from wiclosure.pipeline.stages import run as stages
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import WirelessLog

PathLike: TypeAlias = str | Path


@one_blas_thread
def run(
    data: PathLike | Mapping[str, PathLike],
    *,
    candidate_filter: str | CandidateFilter | None = None,
    config: Config | Mapping[str, Any] | PathLike | None = None,
    wireless: PathLike | Sequence[PathLike] | WirelessLog = (),
    limit: int | None = None,
    jobs: int = 1,
    cache: bool = True,
    progress: bool | Callable[[str, int, int | None], None] = False,
) -> RunResult:
    """Merges the recordings of several robots into one map: what `wiclosure run` does, without writing a folder.

    >>> import wiclosure
    >>> result = wiclosure.run("scenario:shell-space", candidate_filter="wiclosure", limit=20, cache=False)
    >>> sorted(result.merged)
    ['alpha', 'beta']
    >>> result.metrics["filter"], result.metrics["pairs_kept"] <= result.metrics["pairs_total"]
    ('wiclosure', True)
    >>> result.merged["beta"]  # every scan of beta, in the frame of the map
    Trajectory('beta', 20 poses, 3.8 s, 0.7 m)

    Args:
        data: a `dataset.yaml` or its folder, `scenario:NAME`, or recordings by the robot's name:
            `{"alpha": "a.bag", "beta": "b_bag/"}`.
        candidate_filter: name of a filter, or a filter of your own; None: `use_filter` of the configuration.
        config: settings as they are, as nested keys (`{"keyframes": {"distance_m": 2}}`), a YAML file, or the name of a
            preset; None: defaults.  `WICLOSURE_...` variables of the environment, which the command line heeds, do not
            count here.
        wireless: wireless logs, or one in memory, besides those of the data set.
        limit: read at most so many scans of each robot.
        jobs: processes.  More than one begin anew by importing the calling script, which then needs the usual
            `if __name__ == "__main__":`.
        cache: keep odometry, descriptors and registrations for later runs, and take those of earlier ones.
        progress: bars on the terminal; or a function of your own, which takes what is being done (`odometry of alpha`),
            how many of its items are done, and of how many (None: not known).

    Returns:
        All that was found.  In a notebook it shows its figures; `result.plot()` draws the map, `result.to_dataframe()`
        lists every proposed closure with its decision and reason.

    Raises:
        InputError: a recording or a log cannot be read, or they do not belong together.
        ConfigError: no such filter, or a setting that cannot be.
    """
    if jobs < 1:
        raise ConfigError(f"jobs is {jobs}; give one process or more")
    resolved = _config(config)
    if isinstance(candidate_filter, str):
        resolved = resolved.model_copy(update={"use_filter": candidate_filter})
    inputs = _inputs(data, wireless, limit)
    if candidate_filter is None or isinstance(candidate_filter, str):
        chosen = stages.candidate_filter(resolved.use_filter, inputs, resolved)
    else:
        chosen = candidate_filter
    shown = _progress(progress)
    kept = StageCache(default_cache_folder() if cache else None)
    prepared = stages.prepare(inputs, resolved, cache=kept, jobs=jobs, progress=shown)
    return stages.run_stages(prepared, chosen, progress=shown)


def _progress(wanted: bool | Callable[[str, int, int | None], None]) -> Progress:
    if callable(wanted):
        return CallbackProgress(wanted)
    return BarProgress() if wanted else NoProgress()


def _config(given: Config | Mapping[str, Any] | PathLike | None) -> Config:
    if given is None:
        return Config()
    if isinstance(given, Config):
        return given
    if isinstance(given, Mapping):
        try:
            return Config.model_validate(given)
        except ValidationError as error:
            raise ConfigError(explain(error, "the settings given", Config)) from None
    return load_config(str(given))


def _inputs(
    data: PathLike | Mapping[str, PathLike],
    wireless: PathLike | Sequence[PathLike] | WirelessLog,
    limit: int | None,
) -> Inputs:
    words = [f"{robot}={path}" for robot, path in data.items()] if isinstance(data, Mapping) else [str(data)]
    if isinstance(wireless, WirelessLog):
        inputs = open_inputs(words, limit=limit)
        return replace(inputs, wireless=inputs.wireless + wireless)
    logs = [wireless] if isinstance(wireless, str | Path) else wireless
    return open_inputs(words, wireless=[str(log) for log in logs], limit=limit)
