"""`wiclosure filter`: candidate pairs from trajectories and radio alone, for other pipelines."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.candidates_csv import write_candidates
from wiclosure.formats.filter_summary import filter_summary
from wiclosure.pipeline.config import Config, dump_config
from wiclosure.pipeline.data.named_trajectories import named_trajectories
from wiclosure.pipeline.mutual_check.verdicts import out_of_time
from wiclosure.pipeline.radio.read import read_radio
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.runtime.output import whole_file, whole_folder, write_json
from wiclosure.types import FilterResult, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.registry import make_filter
from wiclosure.workers import Workers

logger = logging.getLogger(__name__)

MANY_PAIRS = 5_000_000
"""From here on writing takes long enough to say so: some 20 s and 400 MB."""


Report: TypeAlias = Callable[[Path, FilterResult, Mapping[str, Trajectory], WirelessLog, Config], None]


@dataclass(frozen=True, slots=True)
class Outputs:
    """Files to write; None: not wanted."""

    candidates: Path | None = None
    summary: Path | None = None
    pictures: Path | None = None
    overwrite: bool = False

    def require_free(self) -> None:
        """Fails before any work where a file would be replaced unasked.

        Raises:
            OutputError: it exists.
        """
        if self.candidates is not None and self.candidates == self.summary:
            raise OutputError(f"{self.summary} is named for the candidates and for the summary; name two files")
        for path in (self.candidates, self.summary, self.pictures):
            if path is not None and path.exists() and not self.overwrite:
                raise OutputError(f"{path} exists already; choose another name, or replace it with --overwrite")


def filter_candidates(
    trajectories: Sequence[str],
    logs: Sequence[RadioSource],
    *,
    config: Config,
    outputs: Outputs,
    report: Report | None = None,
    workers: Workers | None = None,
) -> FilterResult:
    """Reads, filters, writes.

    Args:
        trajectories: `name=file` words; pair indices refer to the rows of the files.
        logs: radio logs, by path.
        config: settings; `use_filter` names the filter.
        outputs: files to write.
        report: writes a page into the folder of the pictures.
        workers: who works on pairs of robots, where there are many; None: this process.

    Raises:
        InputError: a file is missing or malformed, or the log mentions a robot without a trajectory.
        ConfigError: fewer than two robots.
        OutputError: a file exists or cannot be written.
    """
    outputs.require_free()
    robots = named_trajectories(trajectories, config.drift)
    wireless = _read_logs(logs, robots)
    result = make_filter(config.use_filter, config.filter, workers=workers).candidates(robots, wireless)
    for sentence in out_of_time(wireless, robots):
        logger.warning("%s", sentence)
    if outputs.candidates is not None:
        if result.pairs_kept > MANY_PAIRS:
            logger.warning(
                "%s pairs are written to %s; thin the trajectories to keyframes, a metre or two apart, for fewer",
                f"{result.pairs_kept:,}",
                outputs.candidates,
            )
        with whole_file(outputs.candidates) as scratch:
            write_candidates(scratch, result.pairs, robots)
    if outputs.summary is not None:
        with whole_file(outputs.summary) as scratch:
            write_json(scratch, filter_summary(result))
    if outputs.pictures is not None:
        from wiclosure.wiclosure_filter.plot import save_pictures

        with whole_folder(outputs.pictures, overwrite=outputs.overwrite) as scratch:
            save_pictures(result, robots, wireless, config.filter, scratch)
            (scratch / "config.yaml").write_text(dump_config(config), encoding="utf-8")
            if report is not None:
                report(scratch, result, robots, wireless, config)
    return result


def _read_logs(sources: Sequence[RadioSource], robots: dict[str, Trajectory]) -> WirelessLog:
    log = WirelessLog()
    for source in sources:
        read = read_radio(source, robots).log
        if unknown := sorted(read.robots() - set(robots)):
            raise InputError(
                f"{source.path} mentions the robot {unknown[0]!r}, but trajectories are given for {', '.join(robots)};"
                f" add --trajectory {unknown[0]}=FILE, or name the robots alike"
            )
        log += read
    return log
