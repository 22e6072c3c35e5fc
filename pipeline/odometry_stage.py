"""The first stage of a run: every robot goes through its own scans, before it meets others."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing import active_children, get_context
from multiprocessing.queues import SimpleQueue
from typing import TypeAlias

from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.front_end import FrontEndResult, OdometryRun, describe_all
from wiclosure.frontends.front_end_result import Descriptors, OdometryResult
from wiclosure.pipeline.cache import StageCache
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.inputs import RobotInput
from wiclosure.pipeline.progress import Progress
from wiclosure.types import Scan

Shown: TypeAlias = Callable[[str, int], None]
"""Takes a robot's name and how many of its scans are done."""

_REPORT_S = 0.1


def front_ends(
    robots: Sequence[RobotInput], config: Config, *, cache: StageCache, jobs: int, progress: Progress
) -> tuple[dict[str, FrontEndResult], tuple[str, ...]]:
    """Odometry, keyframes and descriptors of every robot, and the names of those whose odometry was in the cache.

    Args:
        robots: the recordings.
        config: settings.
        cache: results of earlier runs.
        jobs: processes; each works on one robot at a time, and on one core. Results are the same for any number.
        progress: shows how far it is.

    Raises:
        InputError: a recording cannot be read, or has no usable scan.
    """
    with progress.together({robot.robot: len(robot.scans) for robot in robots}, "odometry of") as shown:
        if jobs > 1 and len(robots) > 1:
            done = _in_processes(robots, config, cache, min(jobs, len(robots)), shown)
        else:
            done = [_front_end(robot, config, cache, shown) for robot in robots]
    reused = tuple(result.robot for result, from_cache in done if from_cache)
    return {result.robot: result for result, _ in done}, reused


def left_out(robot: RobotInput, result: FrontEndResult) -> tuple[str, ...]:
    """Sentences on the scans that the front end could not use."""
    counts = result.counts
    sentences = []
    if counts.sparse:
        sentences.append(f"{counts.sparse} of {counts.scans} scans have too few points in range and were skipped")
    if counts.late:
        sentences.append(f"{counts.late} of {counts.scans} scans have stamps that repeat or go back and were skipped")
    if counts.outside:
        sentences.append(f"{counts.outside} of {counts.scans} scans lie outside the recorded odometry and were skipped")
    if robot.salvaged:
        sentences.append(f"{counts.scans} scans were read with --salvage; damaged ones, if any, are not among them")
    if counts.scans < len(robot.scans):
        sentences.append(f"only {counts.scans} of {len(robot.scans)} announced scans could be read")
    return tuple(f"{robot.robot}: {sentence}" for sentence in sentences)


def _in_processes(
    robots: Sequence[RobotInput], config: Config, cache: StageCache, jobs: int, shown: Shown
) -> list[tuple[FrontEndResult, bool]]:
    """One robot a process; when this one is interrupted, the workers are ended and not waited for."""
    # Ctrl-C reaches workers too, even while they still import: they inherit that it is none of their business.
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    fresh = get_context("spawn")
    reports: SimpleQueue[tuple[str, int]] = fresh.SimpleQueue()
    pool = ProcessPoolExecutor(jobs, mp_context=fresh, initializer=_Worker.start, initargs=(reports,))
    try:
        work = [pool.submit(_Worker.front_end, robot, config, cache) for robot in robots]
        signal.signal(signal.SIGINT, handler)
        waiting = set(work)
        while waiting:
            done, waiting = wait(waiting, timeout=2 * _REPORT_S, return_when=FIRST_COMPLETED)
            while not reports.empty():
                shown(*reports.get())
            for future in done:
                future.result()  # whatever one robot lacks is said at once, not after the others are done
        return [future.result() for future in work]
    except BaseException:
        for worker in active_children():
            worker.terminate()
        raise
    finally:
        signal.signal(signal.SIGINT, handler)
        pool.shutdown(cancel_futures=True)


class _Worker:
    """What happens in another process; its reports go to the first one."""

    reports: SimpleQueue[tuple[str, int]]

    @classmethod
    def start(cls, reports: SimpleQueue[tuple[str, int]]) -> None:
        cls.reports = reports

    @classmethod
    def front_end(cls, robot: RobotInput, config: Config, cache: StageCache) -> tuple[FrontEndResult, bool]:
        return _front_end(robot, config, cache, lambda name, scans: cls.reports.put((name, scans)))


def _front_end(robot: RobotInput, config: Config, cache: StageCache, shown: Shown) -> tuple[FrontEndResult, bool]:
    """Each stage depends on what it uses, and on no other setting: another descriptor needs no new odometry."""
    odometry = [robot.robot, robot.identity, _of_odometry(config.odometry), config.keyframes.model_dump()]
    went, from_cache = cache.reuse(
        "odometry",
        odometry,
        load=OdometryResult.load,
        save=OdometryResult.save,
        compute=lambda: _odometry(robot, config, shown),
    )
    described, _ = cache.reuse(
        "descriptors",
        [odometry, config.scan_context.model_dump()],
        load=Descriptors.load,
        save=Descriptors.save,
        compute=lambda: describe_all(went.clouds, config.scan_context),
    )
    return FrontEndResult.of(robot.robot, config.drift, went, described), from_cache


def _of_odometry(settings: OdometrySettings) -> dict[str, object]:
    """The settings that change the result."""
    return settings.model_dump(exclude={"num_threads"})


def _odometry(robot: RobotInput, config: Config, shown: Shown) -> OdometryResult:
    recorded = robot.odometry if config.odometry.source == "recorded" else None
    run = OdometryRun(config.odometry, config.keyframes, robot.robot, recorded)
    for scan in _reported(robot.scans, robot.robot, shown):
        run.process(scan)
    return run.result()


def _reported(scans: Iterable[Scan], robot: str, shown: Shown) -> Iterator[Scan]:
    """The same scans; how many passed is shown some times a second, and at the end."""
    count, last_s = 0, time.monotonic()
    for scan in scans:
        yield scan
        count += 1
        if time.monotonic() - last_s > _REPORT_S:
            shown(robot, count)
            last_s = time.monotonic()
    shown(robot, count)
