"""A first `dataset.yaml` from what lies in a folder: what is sure as it is, what is guessed with a mark."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from wiclosure.errors import InputError
from wiclosure.pipeline.data.folders.survey import Found
from wiclosure.pipeline.radio.read import RadioReading, read_radio
from wiclosure.pipeline.radio.readers.tag_names import number_at_end
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.runtime.paths import is_folder
from wiclosure.pipeline.sources.info import TopicInfo
from wiclosure.pipeline.sources.poses.pose_topics import ODOMETRY_TYPE

GUESS = "GUESS"
_ENDINGS = re.compile(r"([_.-]?(rosbag2?|bag2?|mcap|lidar|scans|data|recording)|\.\w+)+$", re.IGNORECASE)
_TRUTH = re.compile(r"(^|[_.-])(gt|truth|ground_?truth|groundtruth|mocap|vicon|reference|ref)([_.-]|$)", re.IGNORECASE)
_TRUTH_TOPIC = re.compile(r"ground_?truth|vrpn|vicon|mocap|optitrack|qualisys|leica|(^|/)gt(/|$)", re.IGNORECASE)
_ODOMETRY = re.compile(r"odom|(^|[_.-])(lio|vio|slam)([_.-]|$)", re.IGNORECASE)
_SENSOR = re.compile(
    r"(^|[_.-])(front|rear|back|left|right|top|bottom|center|centre|middle|up|down|upper|lower|main|roof|[fr][lr])"
    r"([_.-]|$)|lidar|velodyne|ouster|livox|hesai|rslidar|pandar|laser|points|cloud|^os\d?_|^vlp|^sensors?$",
    re.IGNORECASE,
)
_LOOKS_LIKE_MM = 200.0  # metres, median: UWB does not reach so far


@dataclass(slots=True)
class _Robot:
    """The lines of one robot's entry, and topics that could be its odometry."""

    scans: Found
    lines: list[str]
    odometry: list[TopicInfo] = field(default_factory=list)


def draft_dataset(folder: Path, found: Sequence[Found]) -> str:
    """The text of a data set file, with comments; guesses are marked.

    Args:
        folder: where the file is to lie.
        found: what is there.

    Raises:
        InputError: nothing there holds scans.
    """
    robots = _robots(folder, found)
    if not robots:
        seen = "; ".join(f"{item.path.name}: {item.holds}" for item in found[:8]) or "nothing"
        raise InputError(f"{folder} holds no recording with point clouds ({seen})")
    unused = _add_trajectories(folder, robots, found)
    lines = [
        "# Written by `wiclosure init`; every key is explained in docs/dataset.md. Look at the lines with GUESS.",
        "robots:",
    ]
    for name, robot in robots.items():
        lines += [f"  {name}:", *(f"    {line}" for line in robot.lines)]
        lines += [
            f"    # odometry_topic: {topic.name}  # {topic.count} {topic.msgtype}: used in the place of KISS-ICP"
            for topic in robot.odometry
        ]
        lines += [
            f"    # ground_truth_topic: {topic.name}  # {GUESS}: {topic.count} {topic.msgtype}"
            for topic in (robot.scans.recording.topics if robot.scans.recording else ())
            if topic.count and topic.msgtype.startswith("geometry_msgs/") and _TRUTH_TOPIC.search(topic.name)
        ]
    lines += _wireless(folder, list(robots), found)
    lines += [f"# not used: {_relative(folder, item.path)} ({item.holds})" for item in unused]
    return "\n".join(lines) + "\n"


# -------------------------------------------------------------------------------------------------------------- robots
def _robots(folder: Path, found: Sequence[Found]) -> dict[str, _Robot]:
    robots: dict[str, _Robot] = {}
    for item in found:
        path = _relative(folder, item.path)
        if item.layouts:
            layout = f"layout: {item.layouts[0]}  # {GUESS}: by the length of the records in its .bin files"
            _put(robots, _name_of(item.path), _Robot(item, [f"scans: {_quoted(path)}", layout]))
        if item.kind != "recording" or item.recording is None:
            continue
        clouds = [topic for topic in item.recording.topics if topic.first_cloud is not None]
        odometry = [topic for topic in item.recording.topics if topic.msgtype == ODOMETRY_TYPE and topic.count]
        if not item.recording.topics:
            _put(robots, _name_of(item.path), _Robot(item, [f"scans: {_quoted(path)}"]))
        elif len(clouds) == 1:
            lines = [f"scans: {_quoted(path)}", f"topic: {clouds[0].name}"]
            _put(robots, _name_of(item.path), _Robot(item, lines, odometry))
        elif _is_team(clouds):
            for topic in clouds:
                own = [other for other in odometry if _namespace(other) == _namespace(topic)]
                lines = [f"scans: {_quoted(path)}", f"topic: {topic.name}  # {GUESS}: a robot for each namespace"]
                _put(robots, _namespace(topic), _Robot(item, lines, own))
        elif clouds:
            most = max(clouds, key=lambda topic: topic.count)
            others = ", ".join(topic.name for topic in clouds if topic is not most)
            lines = [f"scans: {_quoted(path)}", f"topic: {most.name}  # {GUESS}: others are {others}"]
            _put(robots, _name_of(item.path), _Robot(item, lines, odometry))
    return robots


def _is_team(clouds: Sequence[TopicInfo]) -> bool:
    """Whether topics of one bag are of a robot each: in namespaces of their own that name no places on a robot."""
    namespaces = {_namespace(topic) for topic in clouds}
    return len(clouds) > 1 and len(namespaces) == len(clouds) and not any(map(_SENSOR.search, namespaces))


def _put(robots: dict[str, _Robot], name: str, robot: _Robot) -> None:
    """Under the name, or with a number behind where it is taken."""
    base, number = name, 2
    while name in robots or name == "team":
        name, number = f"{base}_{number}", number + 1
    robots[name] = robot


def _name_of(path: Path) -> str:
    """`alpha` of `alpha_bag/` and `alpha.bag`."""
    plain = _ENDINGS.sub("", path.name) or path.stem
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).lstrip(".-") or "robot"


def _namespace(topic: TopicInfo) -> str:
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", topic.name.strip("/").split("/")[0])


def _add_trajectories(folder: Path, robots: Mapping[str, _Robot], found: Iterable[Found]) -> list[Found]:
    """Adds truth and odometry by the names of their files; what fits no robot comes back."""
    unused: list[Found] = []
    for item in found:
        owners = [name for name in robots if name.casefold() in str(item.path.relative_to(folder)).casefold()]
        if item.kind == "unknown" or (
            not item.layouts and item.kind == "recording" and not any(r.scans is item for r in robots.values())
        ):
            unused.append(item)
        if item.kind != "trajectory":
            continue
        path = _quoted(_relative(folder, item.path))
        if not owners:
            unused.append(item)
            continue
        robot = robots[max(owners, key=len)]
        if _TRUTH.search(item.path.stem):
            robot.lines.append(f"ground_truth: {path}  # {item.holds}")
        elif _ODOMETRY.search(item.path.stem):
            robot.lines.append(f"# odometry: {path}  # {item.holds}: used in the place of KISS-ICP")
        else:
            robot.lines.append(f"# ground_truth: {path}  # {GUESS}: {item.holds}; or is it odometry?")
    return unused


# --------------------------------------------------------------------------------------------------------------- radio
def _wireless(folder: Path, robots: Sequence[str], found: Iterable[Found]) -> list[str]:
    entries: list[str] = []
    for item in found:
        if item.kind == "radio":
            entries += _log_entry(folder, item, robots)
        for radio in item.radio:
            entries.append(f"  # {_relative(folder, item.path)}: {radio.sentence(robots[1:])}")
            if len(radio.topics) > 1:
                names, sure = _names_of_ids(radio.ids, robots)
                mark = "" if sure else f"  # {GUESS}: which robot carries which id"
                off = "-" if names else "# -"
                known = _flow(names) if names else f"{{{', '.join(f'{tag}: NAME' for tag in radio.ids)}}}"
                path = _quoted(_relative(folder, item.path))
                entries.append(f"  {off} {{path: {path}, topic: '{radio.topic}', robots: {known}}}{mark}")
    if any(line.lstrip().startswith("-") for line in entries):
        return ["wireless:", *entries]
    if any(line.lstrip().startswith("# -") for line in entries):
        return [
            "wireless:  # none until you name the robots of the ids below, and take away the # before the -",
            *entries,
        ]
    return ["# wireless: []  # no radio log was found beside the topics of the bags", *entries]


def _log_entry(folder: Path, item: Found, robots: Sequence[str]) -> list[str]:
    """The entry of one radio log: a path alone where its robots are ours, else with ids and what was guessed."""
    path = _relative(folder, item.path)
    settings: dict[str, object] = {}
    marks: list[str] = []
    try:
        reading = _read_freely(item.path)
    except InputError as error:
        return [f"  # {_quoted(path)} cannot be read as it is: {error}"]
    if (unit := _guessed_unit(reading)) is not None:
        settings["unit"] = unit
        marks.append(f"unit: the median range would be {_median(reading):.0f} m")
    ids = reading.log.robots()
    names, sure = _names_of_ids(_carried(reading, len(robots)), robots)
    if not ids <= set(robots):
        settings["robots"] = names
        if names and not sure:
            marks.append("robots: which robot carries which tag id")
        if left := sorted(ids - names.keys()) if names else []:
            settings["anchors"] = left
            marks.append("anchors: the ids that are left")
    lines = [f"  # {_quoted(path)}: {item.holds}; {len(reading.log.measurements)} measurements"]
    lines += [f"  # {GUESS}: {mark}" for mark in marks]
    stated = f"{{path: {_quoted(path)}, {_flow(settings)[1:-1]}}}" if settings else _quoted(path)
    if settings.get("robots") == {}:
        known = ", ".join(f"{tag}: NAME" for tag in sorted(ids, key=lambda tag: (len(tag), tag)))
        unit = f", unit: {settings['unit']}" if "unit" in settings else ""
        count = f"{len(ids)} ids, {len(robots)} robots; ids that no robot carries go into anchors: [ID]"
        return [*lines, f"  # - {{path: {_quoted(path)}{unit}, robots: {{{known}}}}}  # {count}"]
    return [*lines, f"  - {stated}"]


def _read_freely(path: Path) -> RadioReading:
    """The log with every id as a robot, and no range too long."""
    return read_radio(RadioSource(path=path, max_range=1e9))


def _carried(reading: RadioReading, count: int) -> list[str]:
    """Ids that robots may carry: those that measure, where they are as many as the robots, else all."""
    ids, measuring = reading.log.robots(), {m.receiver for m in reading.log.measurements}
    return sorted(measuring if len(measuring) == count else ids, key=lambda tag: (len(tag), tag))


def _median(reading: RadioReading) -> float:
    ranges = sorted(m.range_m for m in reading.log.measurements if m.range_m is not None)
    return ranges[len(ranges) // 2] if ranges else 0.0


def _guessed_unit(reading: RadioReading) -> str | None:
    return "mm" if _median(reading) > _LOOKS_LIKE_MM else None


def _names_of_ids(ids: Sequence[str], robots: Sequence[str]) -> tuple[dict[str, str], bool]:
    """Robots of ids: by numbers or names (sure), else in order (a guess) where there are as many; else none."""
    numbers = {number_at_end(robot): robot for robot in robots}
    by_number = {tag: numbers[int(tag)] for tag in ids if tag.isdigit() and int(tag) in numbers}
    if len(by_number) == len(robots) == len(numbers):
        return by_number, True
    named = {tag: robot for tag in ids for robot in robots if _same_name(tag.casefold(), robot.casefold())}
    if len(set(named.values())) == len(robots) or (named.keys() == set(ids) and len(set(named.values())) == len(ids)):
        return named, True
    return (dict(zip(ids, robots, strict=True)) if len(ids) == len(robots) else {}), False


def _same_name(tag: str, robot: str) -> bool:
    """`beta` and `run1_beta`; numbers alone are in many names."""
    return robot in tag or (tag in robot.split("_") and not tag.isdigit())


def _flow(value: object) -> str:
    return yaml.safe_dump(value, default_flow_style=True, width=10_000, sort_keys=False).strip()


def _quoted(path: str) -> str:
    """A path as YAML writes it."""
    return yaml.safe_dump(path, width=10_000).strip().removesuffix("...").strip()


def _relative(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix() + ("/" if is_folder(path) else "")
