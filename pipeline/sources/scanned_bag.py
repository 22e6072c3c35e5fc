"""Bags read record by record: those that rosbags refuses though they are whole, and damaged ones for what is whole.

A scanner yields every message that is whole, in the order of the file, and never raises for damage: it takes it down,
skips a chunk that does not decompress, and stops where the records end.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from pathlib import Path
from tempfile import TemporaryFile
from typing import Protocol

from wiclosure.errors import InputError
from wiclosure.formats.unpacking import UnpackError
from wiclosure.pipeline.sources.bag import Bag, BagTopic, RawMessage, counted_topics, decompressed, same_topic
from wiclosure.pipeline.sources.bag_files import KINDS
from wiclosure.pipeline.sources.salvage.found import Damage, FoundMessage, FoundTopic, TopicChoice, everything
from wiclosure.pipeline.sources.salvage.mcap import scan_mcap
from wiclosure.pipeline.sources.salvage.ros1 import scan_ros1
from wiclosure.pipeline.sources.salvage.sqlite import scan_sqlite3

logger = logging.getLogger(__name__)


class Scanner(Protocol):
    """Reads one kind of file."""

    def __call__(self, path: Path, damage: Damage, wanted: TopicChoice = everything) -> Iterator[FoundMessage]:
        """All whole messages; data of topics that are not wanted may be left out where that saves time."""


_SCANNERS: Mapping[str, Scanner] = {"ros1": scan_ros1, "mcap": scan_mcap, "sqlite3": scan_sqlite3}


def scan_file(path: Path, kind: str, damage: Damage, wanted: TopicChoice = everything) -> Iterator[FoundMessage]:
    """All whole messages of one file of the given kind (`ros1`, `mcap` or `sqlite3`); `damage` takes down the rest."""
    return _SCANNERS[kind](path, damage, wanted)


@dataclass(frozen=True, slots=True)
class BagSurvey:
    """What a scan of all records found.

    Args:
        topics: by name, with the number of whole messages.
        start_ns, end_ns: times of the first and last message.
        unordered: topics whose messages do not stand in order of time.
        damage: what could not be read; none where the bag is whole.
    """

    topics: Mapping[str, BagTopic]
    start_ns: int
    end_ns: int
    unordered: frozenset[str]
    damage: tuple[str, ...]

    @property
    def count(self) -> int:
        """Whole messages."""
        return sum(topic.count for topic in self.topics.values())


def survey_bag(kind: str, files: Sequence[Path], *, contents: bool = True) -> BagSurvey:
    """Scans all records; without `contents`, what only the messages' data would tell is not looked at."""
    states = [file.stat() for file in files]
    return _survey_of(kind, tuple((f, s.st_size, s.st_mtime_ns) for f, s in zip(files, states, strict=True)), contents)


@lru_cache(maxsize=32)
def _survey_of(kind: str, files: tuple[tuple[Path, int, int], ...], contents: bool) -> BagSurvey:
    """Reads everything once; kept for as long as the files do not change, because it takes long."""
    counts: Counter[FoundTopic] = Counter()
    latest_ns: dict[str, int] = {}
    unordered: set[str] = set()
    damage, start_ns, end_ns = Damage(), 2**63 - 1, 0
    wanted = everything if contents else _nothing
    scans = (scan_file(file, kind, damage, wanted) for file, _, _ in files)
    for topic, stamp_ns, _ in chain.from_iterable(scans):
        counts[topic] += 1
        if stamp_ns < latest_ns.get(topic.name, stamp_ns):
            unordered.add(topic.name)
        latest_ns[topic.name] = max(stamp_ns, latest_ns.get(topic.name, stamp_ns))
        start_ns, end_ns = min(start_ns, stamp_ns), max(end_ns, stamp_ns)
    return BagSurvey(counted_topics(counts.items()), start_ns, end_ns, frozenset(unordered), tuple(damage.found))


def scanned_bag(path: Path, kind: str, files: Sequence[Path], found: BagSurvey, *, salvaged: bool = False) -> Bag:
    """A bag that is read record by record.

    Raises:
        InputError: it holds no whole message.
    """
    if not found.count:
        raise InputError(f"{path} holds no whole message, nothing can be salvaged; record it again")

    def read(topic: str) -> Iterator[RawMessage]:
        chosen = found.topics[topic].found
        scans = (scan_file(file, kind, Damage(), lambda found: same_topic(found, chosen)) for file in files)
        messages = (message for message in chain.from_iterable(scans) if same_topic(message.topic, chosen))
        for message in _in_order(messages) if topic in found.unordered else messages:
            try:
                raw = decompressed(message.data)
            except UnpackError as error:
                place = f"a message of {path}, topic {topic}, cannot be unpacked: {error}"
                if not salvaged:
                    raise InputError(f"{place}; add --salvage to use the others") from error
                logger.warning("left out: %s", place)
            else:
                yield message.stamp_ns, raw

    return Bag(path, kind, found.topics, found.start_ns, found.end_ns, read, salvaged)


def _nothing(topic: FoundTopic) -> bool:
    return False


def _in_order(messages: Iterator[FoundMessage]) -> Iterator[FoundMessage]:
    """The messages in order of time; they wait on the disk, for they may be more than memory holds."""
    with TemporaryFile(prefix="wiclosure-bag-") as spool:
        places = []
        for message in messages:
            places.append((message.stamp_ns, spool.tell(), len(message.data), message.topic))
            spool.write(message.data)
        for stamp_ns, start, length, topic in sorted(places, key=lambda place: place[0]):
            spool.seek(start)
            yield FoundMessage(topic, stamp_ns, spool.read(length))


def damaged(path: Path, kind: str, files: Sequence[Path], reason: str) -> InputError:
    """The error for a bag without index or with damage: says what could be saved."""
    found = survey_bag(kind, files)
    reason = " ".join(reason.split()).rstrip(".")
    if not found.count:
        return InputError(f"{path} cannot be read as a {KINDS[kind]} ({reason}), and holds no whole message")
    largest = sorted(found.topics.values(), key=lambda topic: -topic.count)[:5]
    shares = ", ".join(f"{topic.count} on {topic.name}" for topic in largest)
    return InputError(
        f"{path} is truncated, damaged or has no index ({reason}): {found.count} messages can be read ({shares});"
        " add --salvage to use them"
    )
