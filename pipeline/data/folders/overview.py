"""What a folder, a data set or a file that is no recording holds, and what a run would use of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from wiclosure.pipeline.data.dataset import Dataset, load_dataset
from wiclosure.pipeline.data.dataset_file import DATASET_FILE
from wiclosure.pipeline.data.folders.survey import Found, is_recording, survey, survey_file
from wiclosure.pipeline.radio.unused import unused_radio
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.info import RecordingInfo, recording_info
from wiclosure.pipeline.sources.messages.ros_types import HEADING_TYPE, MEASUREMENT_TYPE

OWN_RADIO = (MEASUREMENT_TYPE, HEADING_TYPE)


@dataclass(frozen=True, slots=True)
class Entry:
    """One line.

    Args:
        path: file or folder; of a topic, its bag.
        what: kind and content.
        use: for what a run would use it; empty: for nothing.
    """

    path: Path
    what: str
    use: str


def overview(path: Path, *, salvage: bool = False) -> list[Entry]:
    """Lines for a folder, a `dataset.yaml` or a log; none for a recording, which has more to show.

    Raises:
        InputError: the data set file is malformed.
    """
    if not path.exists() or is_recording(path):
        return []
    is_file = path.is_file() and path.suffix.lower() in {".yaml", ".yml"}
    folder = path.parent if is_file else path
    if path.is_file() and not is_file:
        return [_entry(survey_file(path), None)]
    file = path if is_file else folder / DATASET_FILE
    dataset = load_dataset([str(file)]) if file.is_file() else None
    entries = [_entry(found, dataset) for found in survey(folder, salvage=salvage)]
    if dataset is None:
        return entries
    return entries + _elsewhere(folder, dataset, {entry.path for entry in entries})


def recording_overview(path: Path, *, salvage: bool = False) -> RecordingInfo:
    """What a recording holds; its notes tell what radio in it a run would leave alone, and how to use it.

    Raises:
        InputError: see `wiclosure.pipeline.sources.info.recording_info`.
    """
    found = recording_info(path, salvage=salvage)
    radio = unused_radio(path, (), salvage=salvage) if bag_kind(path) else []
    return replace(found, notes=found.notes + tuple(f"{unused.sentence(())}." for unused in radio))


def _entry(found: Found, dataset: Dataset | None) -> Entry:
    lines, use = [f"{found.kind}: {found.holds}"], _uses(found.path, dataset)
    if found.recording is not None:
        if use and any(topic.msgtype in OWN_RADIO for topic in found.recording.topics):
            use += ", wireless"  # read from the bags of all robots, without being named
        lines += [f"  {topic.name}: {topic.count:,} x {topic.msgtype}" for topic in found.recording.topics]
        others = [robot for robot in dataset.robots if f"scans of {robot}" not in use] if dataset else []
        said = {radio.topic for radio in found.radio}
        read = {source.topic for source in dataset.wireless} if dataset else set()
        lines += [f"  {radio.sentence(others)}" for radio in found.radio if radio.topic in said - read]
    return Entry(found.path, "\n".join(lines), use)


def _uses(path: Path, dataset: Dataset | None) -> str:
    """What of the data set is in this file."""
    if dataset is None:
        return "" if path.name != DATASET_FILE else "data set"
    roles: list[str] = []
    for robot, recording in dataset.robots.items():
        roles += [
            f"{role} of {robot}"
            for role, file in (
                ("scans", recording.scans),
                ("ground truth", recording.ground_truth),
                ("odometry", recording.odometry),
            )
            if file is not None and file.resolve() == path.resolve()
        ]
    if any(source.path is not None and source.path.resolve() == path.resolve() for source in dataset.wireless):
        roles.append("wireless")
    if dataset.origin is not None and dataset.origin.resolve() == path.resolve():
        roles.append("data set")
    return ", ".join(roles)


def _elsewhere(folder: Path, dataset: Dataset, listed: set[Path]) -> list[Entry]:
    """What the data set names outside the folder."""
    named = [recording.scans for recording in dataset.robots.values()]
    named += [file for r in dataset.robots.values() for file in (r.ground_truth, r.odometry) if file is not None]
    named += [source.path for source in dataset.wireless if source.path is not None]
    known = {path.resolve() for path in listed}
    return [
        Entry(path, "elsewhere", _uses(path, dataset)) for path in dict.fromkeys(named) if path.resolve() not in known
    ]
