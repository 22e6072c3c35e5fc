"""The first stage of a run: every robot goes through its own scans, before it meets others."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass
from itertools import islice
from typing import TypeAlias

from pydantic import ValidationError

from wiclosure.errors import ConfigError
from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.front_end import Followed, OdometryRun, describe_all
from wiclosure.frontends.front_end_result import Descriptors, FrontEndResult, OdometryResult
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import RobotInput
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.checkpoints import Checkpoints
from wiclosure.pipeline.runtime.processes import local_workers
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.runtime.reading_ahead import read_ahead
from wiclosure.pipeline.runtime.settings_text import explain
from wiclosure.pipeline.stages.viewer import NoViewer, Viewer
from wiclosure.types import Scan
from wiclosure.workers import Workers, require_wanted, tell

Shown: TypeAlias = Callable[[str, int, Followed | None], None]
"""Takes a robot's name, how many of its scans are done, and the last of them where a viewer follows scans."""

_REPORT_S = 0.1


def front_ends(
    robots: Sequence[RobotInput],
    config: Config,
    *,
    cache: StageCache,
    jobs: int,
    progress: Progress,
    also: Sequence[Config] = (),
    viewer: Viewer | None = None,
    workers: Workers | None = None,
) -> tuple[dict[str, FrontEndResult], tuple[str, ...]]:
    """Odometry, keyframes and descriptors of every robot, and the names of those whose odometry was in the cache.

    Args:
        robots: the recordings.
        config: settings.
        cache: results of earlier runs.
        jobs: processes; each works on one robot at a time, and on one core.  Those beyond the number of robots read
            ahead, for a robot each.  Results are the same for any number.
        progress: shows how far it is.
        also: configurations that will be asked for next; where only their keyframes differ, one odometry serves all,
            and the cache keeps what it gave.
        viewer: is shown scans as they are followed, if it wants; not from a cluster, which would have to send them.
        workers: a cluster that does the work, each worker for one robot at a time; None: processes here.

    Raises:
        InputError: a recording cannot be read, or has no usable scan.
        ConfigError: a cluster without a cache, or one that does not share this one's.
    """
    if workers is not None and workers.remote and cache.folder is None:
        raise ConfigError("a cluster hands its results over by the cache; leave out --no-cache")
    spare, seen = 0 if workers else max(0, jobs - len(robots)), viewer or NoViewer()
    work = [
        _Work(robot, (config, *also), cache, ahead=number < spare, seen=seen.follows_scans and workers is None)
        for number, robot in enumerate(robots)
    ]
    with progress.together({robot.robot: len(robot.scans) for robot in robots}, "odometry of") as counted:

        def shown(robot: str, done: int, followed: Followed | None) -> None:
            counted(robot, done)
            if followed is not None:
                seen.scan(robot, followed)

        done = _done(work, workers or local_workers(1 if len(robots) == 1 else jobs), shown)
    reused = tuple(result.robot for result, from_cache in done if from_cache)
    return {result.robot: result for result, _ in done}, reused


def odometry_into_cache(
    robots: Mapping[str, RobotInput], configs: Sequence[Config], cache: StageCache, workers: Workers, progress: Progress
) -> frozenset[str]:
    """Leaves what `front_ends` computes in the cache; which of these were there.

    Args:
        robots: recordings, of several worlds too, by the name that is shown.
        configs: settings, and those that will be asked for next.
        cache: that the workers share.
        workers: who does the work, each for one robot at a time.
        progress: shows how far it is.

    Raises:
        InputError: a recording cannot be read, or has no usable scan.
    """
    work = [_Work(robot, configs, cache, ahead=False, shown_as=name) for name, robot in robots.items()]
    with (
        progress.together({name: len(robot.scans) for name, robot in robots.items()}, "odometry of") as counted,
        closing(workers.each(_kept, work, told=lambda name, done, _: counted(name, done))) as kept,
    ):
        reused = dict(kept)
    return frozenset(name for number, name in enumerate(robots) if reused[number])


def _done(work: Sequence[_Work], workers: Workers, shown: Shown) -> list[tuple[FrontEndResult, bool]]:
    """What one robot lacks is said at once, not after the others are done."""
    if workers.remote:
        with closing(workers.each(_kept, work, told=shown)) as kept:
            reused = dict(kept)
        return [(one.found(), reused[number]) for number, one in enumerate(work)]
    with closing(workers.each(_front_end, work, told=shown)) as done:
        found = dict(done)
    return [found[number] for number in range(len(work))]


def remarks(robot: RobotInput, result: FrontEndResult, config: Config) -> tuple[str, ...]:
    """Sentences on what the front end did to the scans, and which it could not use."""
    counts, chosen = result.counts, odometry_settings(robot, config)
    sentences = []
    if robot.elevation_correction_deg and (angle := chosen.elevation_correction_deg):
        sentences.append(
            f"all beams are turned up by {angle:g} degrees, as KISS-ICP does with KITTI's; --set"
            " odometry.elevation_correction_deg=0 leaves them"
        )
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
    if len(result.found_again_ns):
        sentences.append(_found_again(result))
    if slipped := result.slips.sentence(int(result.odometry.stamps_ns[0])):
        sentences.append(slipped)
    return (*robot.remarks, *(f"{robot.robot}: {sentence}" for sentence in sentences))


def _found_again(result: FrontEndResult) -> str:
    stamps_ns = result.found_again_ns - result.odometry.stamps_ns[0]
    times = ", ".join(f"{at:.1f}" for at in (stamps_ns[:8] * 1e-9).tolist()) + (" ..." if len(stamps_ns) > 8 else "")
    often = "once" if len(stamps_ns) == 1 else f"{len(stamps_ns)} times"
    return (
        f"odometry lost its hold {often}, at {times} s after its start, and was found again by"
        " registering the scan to the last ones from all around"
    )


def odometry_settings(robot: RobotInput, config: Config) -> OdometrySettings:
    """The configuration's, with what the data set says of this robot, and what its recording needs where both are mute.

    Raises:
        ConfigError: the two do not go together.
    """
    merged = config.odometry.model_dump() | dict(robot.odometry_settings)
    if merged["elevation_correction_deg"] is None:
        merged["elevation_correction_deg"] = robot.elevation_correction_deg
    try:
        return OdometrySettings.model_validate(merged)
    except ValidationError as error:
        raise ConfigError(explain(error, f"the settings of robot {robot.robot}", OdometrySettings)) from None


@dataclass(frozen=True, eq=False)
class _Work:
    """One robot's front end.

    Args:
        robot: the recording.
        configs: settings; the cache keeps what those after the first will need.
        cache: results of earlier runs.
        ahead: whether another process reads the scans.
        seen: whether somebody looks at them as they are followed.
        shown_as: how the robot is called to the user; empty: by its name.
    """

    robot: RobotInput
    configs: Sequence[Config]
    cache: StageCache
    ahead: bool
    seen: bool = False
    shown_as: str = ""

    def __str__(self) -> str:
        return f"odometry of {self.name}"

    @property
    def name(self) -> str:
        return self.shown_as or self.robot.robot

    def front_end(self) -> tuple[FrontEndResult, bool]:
        """The result, and whether its odometry was in the cache.

        Each stage depends on what it uses, and on no other setting: another descriptor needs no new odometry.
        """
        config = self.configs[0]
        odometry = _of_odometry(self.robot, config)
        followed, from_cache = self.cache.reuse(
            "odometry",
            odometry,
            load=OdometryResult.load,
            save=OdometryResult.save,
            compute=self._odometry,
        )
        described, _ = self.cache.reuse(
            "descriptors",
            _of_descriptors(odometry, config),
            load=Descriptors.load,
            save=Descriptors.save,
            compute=lambda: describe_all(followed.clouds, config.scan_context),
        )
        return FrontEndResult.of(self.robot.robot, config.drift, followed, described), from_cache

    def found(self) -> FrontEndResult:
        """What another worker left in the cache.

        Raises:
            ConfigError: it is not there.
        """
        config = self.configs[0]
        odometry = _of_odometry(self.robot, config)
        followed = self.cache.find("odometry", odometry, load=OdometryResult.load)
        described = self.cache.find("descriptors", _of_descriptors(odometry, config), load=Descriptors.load)
        if followed is None or described is None:
            raise ConfigError(
                f"the cluster left the odometry of {self.robot.robot} in its own {self.cache.folder}; name a"
                " folder that all machines share (WICLOSURE_CACHE), with room for all of it (WICLOSURE_CACHE_GB)"
            )
        return FrontEndResult.of(self.robot.robot, config.drift, followed, described)

    def _odometry(self) -> OdometryResult:
        """By the first configuration; the cache takes what the others with the same odometry will need."""
        config, robot = self.configs[0], self.robot
        others = [
            c
            for c in self.configs[1:]
            if self.cache.folder is not None and c.odometry == config.odometry and c.keyframes != config.keyframes
        ]
        checkpoints = Checkpoints(self.cache, [_of_odometry(robot, each) for each in (config, *others)])
        settings, keyframes = odometry_settings(robot, config), [c.keyframes for c in (config, *others)]
        run = checkpoints.resumed(lambda: OdometryRun(settings, keyframes, robot.robot, robot.odometry))
        with read_ahead(robot.scans) if self.ahead else nullcontext(robot.scans) as scans:
            left = checkpoints.kept(islice(scans, run.scans, None), run)
            run.process_all(_reported(left, self.name, run.scans, run if self.seen else None))
        result, *further = run.results()
        for other, found in zip(others, further, strict=True):
            self.cache.keep("odometry", _of_odometry(robot, other), found, save=OdometryResult.save)
        checkpoints.drop()
        return result


def _front_end(work: _Work) -> tuple[FrontEndResult, bool]:
    return work.front_end()


def _kept(work: _Work) -> bool:
    """Leaves the result in the cache; whether its odometry was there."""
    _, from_cache = work.front_end()
    return from_cache


def _of_odometry(robot: RobotInput, config: Config) -> list[object]:
    """What the result of odometry depends on, and is found by in the cache."""
    settings = odometry_settings(robot, config).model_dump(exclude={"num_threads"})
    return [robot.robot, robot.identity, settings, config.keyframes.model_dump()]


def _of_descriptors(odometry: list[object], config: Config) -> list[object]:
    return [odometry, config.scan_context.model_dump()]


def _reported(scans: Iterable[Scan], robot: str, before: int, run: OdometryRun | None) -> Iterator[Scan]:
    """The same scans; how many passed, those before too, is told some times a second; of the run its last, if given."""
    count, last_s = before, time.monotonic()
    for scan in scans:
        require_wanted()
        yield scan
        count += 1
        if time.monotonic() - last_s > _REPORT_S:
            tell(robot, count, run.last if run is not None else None)
            last_s = time.monotonic()
    tell(robot, count, None)
