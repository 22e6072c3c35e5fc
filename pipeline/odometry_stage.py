"""The first stage of a run: every robot goes through its own scans, before it meets others."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context

from wiclosure.drift import DriftModel
from wiclosure.frontends.config import FrontEndSettings
from wiclosure.frontends.front_end import FrontEnd, FrontEndResult
from wiclosure.pipeline.cache import StageCache
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.inputs import RobotInput
from wiclosure.pipeline.progress import NoProgress, Progress


def front_ends(
    robots: Sequence[RobotInput], config: Config, *, cache: StageCache, jobs: int, progress: Progress
) -> tuple[dict[str, FrontEndResult], tuple[str, ...]]:
    """Odometry, keyframes and descriptors of every robot, and the names of those taken from the cache.

    Args:
        robots: the recordings.
        config: settings.
        cache: results of earlier runs.
        jobs: processes; each works on one robot at a time. KISS-ICP itself uses all cores: more than one process only
            helps where there are many cores.
        progress: shows how far it is.

    Raises:
        InputError: a recording cannot be read, or has no usable scan.
    """
    settings = FrontEndSettings(odometry=config.odometry, keyframes=config.keyframes, scan_context=config.scan_context)
    if jobs > 1 and len(robots) > 1:
        done = _in_processes(robots, settings, config.drift, cache, min(jobs, len(robots)), progress)
    else:
        done = [_cached(robot, settings, config.drift, cache, progress) for robot in robots]
    names = [robot.robot for robot in robots]
    reused = tuple(name for name, (_, from_cache) in zip(names, done, strict=True) if from_cache)
    return {name: result for name, (result, _) in zip(names, done, strict=True)}, reused


def left_out(robot: RobotInput, result: FrontEndResult) -> tuple[str, ...]:
    """Sentences on the scans that the front end could not use."""
    counts = result.counts
    sentences = []
    if counts.sparse:
        sentences.append(f"{counts.sparse} of {counts.scans} scans have too few points in range and were skipped")
    if counts.late:
        sentences.append(f"{counts.late} of {counts.scans} scans have stamps that repeat or go back and were skipped")
    if robot.salvaged:
        sentences.append(f"{counts.scans} scans were read with --salvage; damaged ones, if any, are not among them")
    if counts.scans < len(robot.scans):
        sentences.append(f"only {counts.scans} of {len(robot.scans)} announced scans could be read")
    return tuple(f"{robot.robot}: {sentence}" for sentence in sentences)


def _in_processes(
    robots: Sequence[RobotInput],
    settings: FrontEndSettings,
    drift: DriftModel,
    cache: StageCache,
    jobs: int,
    progress: Progress,
) -> list[tuple[FrontEndResult, bool]]:
    """One robot a process; when this one is interrupted, the workers are ended and not waited for."""
    # Ctrl-C reaches workers too, even while they still import: they inherit that it is none of their business.
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))
    try:
        work = [pool.submit(_cached, robot, settings, drift, cache, NoProgress()) for robot in robots]
        signal.signal(signal.SIGINT, handler)
        return [future.result() for future in progress.track(work, "odometry", len(work))]
    except BaseException:
        for worker in active_children():
            worker.terminate()
        raise
    finally:
        signal.signal(signal.SIGINT, handler)
        pool.shutdown(cancel_futures=True)


def _cached(
    robot: RobotInput, settings: FrontEndSettings, drift: DriftModel, cache: StageCache, progress: Progress
) -> tuple[FrontEndResult, bool]:
    return cache.reuse(
        "front-end",
        [robot.robot, robot.identity, settings.model_dump(), drift.model_dump()],
        load=FrontEndResult.load,
        save=FrontEndResult.save,
        compute=lambda: _compute(robot, settings, drift, progress),
    )


def _compute(robot: RobotInput, settings: FrontEndSettings, drift: DriftModel, progress: Progress) -> FrontEndResult:
    front_end = FrontEnd(settings, robot.robot, drift)
    for scan in progress.track(robot.scans, f"odometry of {robot.robot}", len(robot.scans)):
        front_end.process(scan)
    return front_end.result()
