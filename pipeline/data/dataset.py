"""A data set: the recordings of several robots, their ground truth, and what they heard of each other by radio."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from wiclosure.display.names import listed
from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.name_pattern import NamePattern
from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.data.dataset_file import DATASET_FILE, read_dataset_file
from wiclosure.pipeline.data.ground_truth import recorded_ground_truth
from wiclosure.pipeline.data.odometry_reader import read_recorded_odometry
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.data.repeated_radio import each_once
from wiclosure.pipeline.radio.read import read_radio
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.radio.unused import unused_radio
from wiclosure.pipeline.runtime.paths import exists, expanded, is_file
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.bags import topic_names
from wiclosure.pipeline.sources.open import open_source
from wiclosure.pipeline.sources.wireless_topics import read_wireless_topics
from wiclosure.suggestions import did_you_mean
from wiclosure.types import Trajectory, WirelessLog

logger = logging.getLogger(__name__)

_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}")
_RESERVED = frozenset({"team"})  # a key beside the robots' names in metrics.json
_FILES_BESIDE = ("_odometry", "_ground_truth")  # a run folder holds NAME.tum and, of each robot, NAME_odometry.tum ...


@dataclass(frozen=True, slots=True)
class Dataset:
    """What a run reads.

    Args:
        robots: recordings by name of the robot, in order.
        wireless: radio logs, besides the wireless topics of the robots' own bags.
        origin: the file that describes the data set, or None.

    Raises:
        InputError: no robots, a name that cannot be part of a file name, or two whose files would have one name.
    """

    robots: Mapping[str, RobotRecording]
    wireless: tuple[RadioSource, ...] = ()
    origin: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if not self.robots:
            raise InputError(f"{self.origin or 'the data set'} names no robots; give at least one")
        where = f"{self.origin}: " if self.origin is not None else ""
        for robot in self.robots:
            if not _NAME.fullmatch(robot) or robot in _RESERVED:
                raise InputError(
                    f"{where}robot name {robot[:120]!r} cannot be used; take letters, digits, '_', '-' and '.', and not"
                    " 'team'"
                )
            if taken := [robot + ending for ending in _FILES_BESIDE if robot + ending in self.robots]:
                raise InputError(
                    f"{where}robot names {robot!r} and {taken[0]!r} cannot stand together, for both would have a file"
                    f" {taken[0]}.tum in the run's folder; rename one of them"
                )

    def scans(self, robot: str, *, limit: int | None = None, salvage: bool = False) -> ScanSource:
        """The robot's recording, its clock set right.

        Raises:
            InputError: see `wiclosure.pipeline.sources.open.open_source`; names the robot as well.
        """
        recording = self.robots[robot]
        try:
            return open_source(
                recording.scans.absolute(),  # workers elsewhere may have another working folder
                topic=recording.topic,
                layout=recording.layout,
                unit=recording.scan_unit,
                limit=limit,
                salvage=salvage,
                time_offset=recording.time_offset,
            )
        except InputError as error:
            raise InputError(f"robot {robot}: {error}") from error

    def ground_truth(self, robot: str, *, salvage: bool = False) -> Trajectory | None:
        """`T_world_body` of the robot, its clock set right, or None where nobody knows it.

        From the robot's file or topic, or from `poses.txt` of a KITTI folder.

        Raises:
            InputError: the file is malformed, or does not overlap in time with the scans.
        """
        recording = self.robots[robot]
        trajectory = recorded_ground_truth(robot, recording, salvage=salvage)
        if trajectory is None:
            return None
        stamps_ns = trajectory.stamps_ns + recording.time_offset_ns
        return Trajectory(robot, stamps_ns, trajectory.poses, trajectory.drift)

    def odometry(self, robot: str, *, salvage: bool = False) -> Trajectory | None:
        """`T_odom_lidar` that the robot brings along, its clock set right, or None where KISS-ICP is to find it.

        Raises:
            InputError: the file or topic cannot be read; names the robot as well.
        """
        recording = self.robots[robot]
        try:
            trajectory = read_recorded_odometry(robot, recording, salvage=salvage)
        except InputError as error:
            raise InputError(f"robot {robot}: {error}") from error
        if trajectory is None:
            return None
        return Trajectory(robot, trajectory.stamps_ns + recording.time_offset_ns, trajectory.poses)

    def wireless_log(self, *, salvage: bool = False) -> WirelessLog:
        """All measurements and headings of all logs and bags, each once (`each_once`), all clocks set right.

        Raises:
            InputError: a log or bag cannot be read, or mentions a robot that the data set does not have.
        """
        logs = [
            (str(source.path), self._known(read_radio(source, self.robots, salvage=salvage).log, source.path))
            for source in self._sources()
        ]
        for robot, recording in self.robots.items():
            if bag_kind(recording.scans):
                links = {topic: (robot, transmitter) for topic, transmitter in recording.ranges.items()}
                log = read_wireless_topics(
                    recording.scans, range_topics=links, ignored=recording.ignored_radio, salvage=salvage
                )
                logs.append((str(recording.scans), self._of_team(log, recording.scans)))
        self._say_unused(salvage=salvage)
        return self._in_common_time(each_once(logs))

    def _sources(self) -> Iterator[RadioSource]:
        """All sources, those of topics without a path once for each robot's bag that has the topic."""
        for source in self.wireless:
            if source.path is not None:
                yield source
                continue
            pattern, found = NamePattern(source.topic or ""), False
            for robot, recording in self.robots.items():
                if not bag_kind(recording.scans):
                    continue
                if any(map(pattern.fits, set(topic_names(recording.scans)) - set(recording.ignored_radio))):
                    found = True
                    yield source.of_bag(recording.scans, robot)
            if not found:
                raise InputError(f"no robot's bag has the topic {source.topic}, which wireless names; check its name")

    def _say_unused(self, *, salvage: bool) -> None:
        """A warning for each topic of the bags that looks like radio and is not read."""
        used = [source.topic for source in self.wireless if source.topic is not None]
        used += [topic for r in self.robots.values() for topic in (*r.ranges, *r.ignored_radio)]
        owners = {recording.scans: robot for robot, recording in self.robots.items()}  # one bag may hold a team
        for scans, owner in owners.items():
            if bag_kind(scans):
                others = [robot for robot in self.robots if robot != owner]
                for radio in unused_radio(scans, used, salvage=salvage):
                    logger.warning("%s: %s", scans, radio.sentence(others))

    def _of_team(self, log: WirelessLog, path: Path) -> WirelessLog:
        """What a bag's own topics hold; nothing of a robot that is mapped alone, as no other is there."""
        others = sorted(log.robots() - set(self.robots))
        if len(self.robots) > 1 or not others:
            return self._known(log, path)
        logger.warning("%s: its radio heard %s, of which no recording is given; it is not used", path, listed(others))
        return WirelessLog()

    def _known(self, log: WirelessLog, path: Path | None) -> WirelessLog:
        for robot in sorted(log.robots() - set(self.robots)):
            raise InputError(
                f"{path} mentions the robot {robot!r}, but the data set has {', '.join(self.robots)};"
                f" {did_you_mean(robot, self.robots)}add its recording, or map the id:"
                f" robots: {{{robot}: {next(iter(self.robots))}}}"
            )
        return log

    def _in_common_time(self, log: WirelessLog) -> WirelessLog:
        """Stamps of each robot moved by its time offset; in order of time again."""
        offset_ns = {robot: recording.time_offset_ns for robot, recording in self.robots.items()}
        if not any(offset_ns.values()):
            return log
        measurements = tuple(
            replace(
                m,
                stamp_ns=m.stamp_ns + offset_ns[m.receiver],
                transmitter_stamp_ns=None
                if m.transmitter_stamp_ns is None
                else m.transmitter_stamp_ns + offset_ns[m.transmitter],
            )
            for m in log.measurements
        )
        headings = tuple(replace(h, stamp_ns=h.stamp_ns + offset_ns[h.robot]) for h in log.headings)
        return WirelessLog() + WirelessLog(measurements, headings)


def load_dataset(args: Sequence[str], *, topic: str | None = None, wireless: Iterable[RadioSource] = ()) -> Dataset:
    """The data set that the user names on the command line.

    Args:
        args: one `dataset.yaml` (or its folder), or recordings as `alpha=path`; a path alone is named by its file name.
        topic: PointCloud2 topic of all bags, whatever the file states.
        wireless: radio logs besides those of the file.

    Raises:
        InputError: something is missing, unknown, or named twice; one line that names it.
    """
    if not args:
        raise ConfigError(f"no data given; name a {DATASET_FILE}, or recordings as alpha=PATH beta=PATH")
    if len(args) == 1 and (file := _dataset_file(args[0])):
        robots, logs = read_dataset_file(file)
        origin: Path | None = file
    else:
        robots, logs, origin = _named_recordings(args), (), None
    if topic is not None:
        robots = {robot: replace(r, topic=topic) if _may_be_bag(r.scans) else r for robot, r in robots.items()}
    _warn_of_repeated(robots)
    return Dataset(robots, (*logs, *wireless), origin)


def _may_be_bag(scans: Path) -> bool:
    """Not where clouds lie in a folder beside the bags of other robots."""
    return not scans.is_dir() or bag_kind(scans) is not None


def _warn_of_repeated(robots: Mapping[str, RobotRecording]) -> None:
    """A recording that stands twice by mistake would merge with itself."""
    first: dict[tuple[Path, str | None], str] = {}
    for robot, recording in robots.items():
        other = first.setdefault((recording.scans.resolve(), recording.topic), robot)
        if other != robot:
            logger.warning("%s and %s have the same scans, %s; is that meant?", other, robot, recording.scans)


def _dataset_file(argument: str) -> Path | None:
    """The file, where the argument names one or its folder."""
    path = expanded(argument)
    if path.suffix.lower() in {".yaml", ".yml"}:
        return path
    return path / DATASET_FILE if is_file(path / DATASET_FILE) else None


def _named_recordings(args: Sequence[str]) -> dict[str, RobotRecording]:
    robots: dict[str, RobotRecording] = {}
    for argument in args:
        name, equals, value = argument.partition("=")
        path = expanded(value if equals else argument)
        robot = name if equals else path.resolve().name.split(".", maxsplit=1)[0]
        if not exists(path):
            raise InputError(f"recording {path} of robot {robot} does not exist; check the path")
        if path.is_file() and path.suffix.lower() in {".yaml", ".yml"}:
            raise InputError(f"{path} stands beside other data; name one {DATASET_FILE}, or recordings only")
        if robot in robots:
            raise InputError(f"two robots are named {robot}; name them apart, as alpha=PATH beta=PATH")
        robots[robot] = RobotRecording(path)
    return robots
