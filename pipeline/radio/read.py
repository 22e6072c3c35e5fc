"""Reads a radio source of any kind."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TypeAlias

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.radio.pyfg import WORDS, read_pyfg_ranges
from wiclosure.formats.radio.wireless_log import read_wireless_log
from wiclosure.formats.radio.wsr import read_wsr_profiles, wsr_wireless_log
from wiclosure.formats.structured_text import parse_json
from wiclosure.pipeline.radio.presets import preset_of_header, preset_settings
from wiclosure.pipeline.radio.readers.account import Account
from wiclosure.pipeline.radio.readers.corrections import CORRECTIONS, corrected
from wiclosure.pipeline.radio.readers.interpret import interpret
from wiclosure.pipeline.radio.readers.rows import Row
from wiclosure.pipeline.radio.readers.tables import line_rows, opened, table_rows
from wiclosure.pipeline.radio.readers.tag_names import TagNames
from wiclosure.pipeline.radio.readers.topics import topic_rows, with_message_preset
from wiclosure.pipeline.radio.source import RadioKind, RadioSource
from wiclosure.pipeline.radio.unused import UnusedRadio, unused_radio
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.wireless_topics import read_wireless_topics
from wiclosure.types import WirelessLog

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RadioReading:
    """What a source held.

    Args:
        log: its measurements, by robots' names, in order of time.
        account: what became of each reading; None for formats that hold nothing else.
        kind: how it was read.
        unused: topics of a bag that look like radio and were not read.
    """

    log: WirelessLog
    account: Account | None
    kind: RadioKind
    unused: tuple[UnusedRadio, ...] = ()


KnownRobots: TypeAlias = Collection[str] | None


def read_radio(source: RadioSource, known: KnownRobots = None, *, salvage: bool = False) -> RadioReading:
    """Reads one source; what is left out is said in the log.

    Args:
        source: where it is and what it means.
        known: the robots that there are; None takes every name.
        salvage: use what can be read of damaged bags.

    Raises:
        InputError: it cannot be read, or holds nothing that its settings describe.
        ConfigError: settings that do not go together.
    """
    if source.path is None:
        raise InputError(f"{source.described()} is a topic of the robots' own bags; name a bag as path")
    if not source.path.exists():
        raise InputError(f"wireless log {source.path} does not exist; check the path")
    path, source = source.path, _with_preset(source)
    kind = source.kind or _kind(path, source)
    reading = _READERS[kind](path, source, known, salvage)
    if reading.account is not None:
        reading.account.report()
    return reading


def _with_preset(source: RadioSource) -> RadioSource:
    """The source laid over its preset."""
    if source.preset is None:
        return source
    stated = source.model_dump(exclude_unset=True)
    settings = {**preset_settings(source.preset, Path()), **stated}
    return RadioSource.model_validate(settings)


def _kind(path: Path, source: RadioSource) -> RadioKind:
    """By what the source says, then by the file's first bytes."""
    if bag_kind(path):
        return "topics"
    if path.is_dir():
        raise InputError(f"wireless log {path} is a folder and no bag; name a file")
    if source.pattern is not None:
        return "lines"
    head = _head(path)
    if head.lstrip().startswith(b"["):
        raise InputError(f"{path} is an array of JSON; write one object a line (jq -c '.[]' does)")
    if head.lstrip().startswith(b"{"):
        first = head.lstrip().splitlines()[0]
        if _is_foreign(first):
            return "table"
        return "jsonl" if b'"type"' in first or path.suffix.lower() != ".json" else "wsr"
    if path.suffix.lower() == ".jsonl":
        return "jsonl"
    words = head.split(maxsplit=1)
    return "pyfg" if words and words[0].decode("latin-1") in WORDS else "table"


def _is_foreign(line: bytes) -> bool:
    """Whether a line is a JSON object of another program than ours."""
    try:
        found = parse_json(line)
    except InputError:
        return False
    return isinstance(found, dict) and found.get("type") not in {"wireless", "heading"} and "stamp" not in found


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(4096)
    except OSError as error:
        raise InputError(f"cannot read the wireless log {path}: {error.strerror}; check the path") from error


# ------------------------------------------------------------------------------------------------------ kind by kind
def _json_lines(path: Path, source: RadioSource, known: KnownRobots, salvage: bool) -> RadioReading:
    _refuse_settings(source, "JSON Lines", {"angle_unit"})
    log = read_wireless_log(path, angle_unit=source.angle_unit)
    if not log.measurements and not log.headings:
        logger.warning("%s: it holds no readings", path)
    return RadioReading(_renamed(log, source, known), None, "jsonl")


def _table(path: Path, source: RadioSource, known: KnownRobots, salvage: bool) -> RadioReading:
    table = opened(path, source)
    if source.preset is None and not source.range_ and (preset := preset_of_header(table.columns)):
        logger.info("%s: its columns are those of the preset %s", path, preset.name)
        source = _with_preset(source.model_copy(update={"preset": preset.name}))
    rows, complete = table_rows(table, source)
    return RadioReading(*_interpreted(rows, complete, known), "table")


def _lines(path: Path, source: RadioSource, known: KnownRobots, salvage: bool) -> RadioReading:
    return RadioReading(*_interpreted(line_rows(path, source), source, known), "lines")


def _topics(path: Path, source: RadioSource, known: KnownRobots, salvage: bool) -> RadioReading:
    if source.topic is None:
        _refuse_settings(source, "a bag without topic:", set())
        log = _renamed(read_wireless_topics(path, salvage=salvage), source, known)
        return RadioReading(log, None, "topics", tuple(unused_radio(path, (), salvage=salvage)))
    source = with_message_preset(path, source, salvage=salvage)
    rows = topic_rows(path, source, salvage=salvage)
    log, account = _interpreted(rows, source, known)
    read = [str(source.topic), f"/{source.topic}"]
    return RadioReading(log, account, "topics", tuple(unused_radio(path, read, salvage=salvage)))


def _factor_graph(path: Path, source: RadioSource, known: KnownRobots, salvage: bool) -> RadioReading:
    rows = (
        Row(
            f"line {found.line}",
            {
                "stamp": found.stamp,
                "from": found.receiver,
                "to": found.transmitter,
                "range": found.range,
                "range_variance": found.variance,
            },
            found.problem,
        )
        for found in read_pyfg_ranges(path)
    )
    return RadioReading(*_interpreted(rows, source.model_copy(update={"stamp_unit": "s"}), known), "pyfg")


def _wsr(path: Path, source: RadioSource, known: KnownRobots, salvage: bool) -> RadioReading:
    _refuse_settings(source, "WSR-Toolbox output", {"stamps"})
    stamps_ns = {trial: round(Decimal(str(stamp)) * 10**9) for trial, stamp in source.stamps.items()}
    profiles = read_wsr_profiles(path)
    if missing := sorted({profile.trial for profile in profiles} - stamps_ns.keys()):
        raise InputError(
            f"{path} is WSR-Toolbox output, which holds no times: {len(missing)} trials have none;"
            f" add stamps: {{{missing[0]}: SECONDS, ...}}"
        )
    log = wsr_wireless_log(profiles, stamps_ns)
    return RadioReading(_renamed(log, source, known), None, "wsr")


_READERS: Mapping[RadioKind, Callable[[Path, RadioSource, KnownRobots, bool], RadioReading]] = {
    "jsonl": _json_lines,
    "table": _table,
    "lines": _lines,
    "topics": _topics,
    "wsr": _wsr,
    "pyfg": _factor_graph,
}


def _interpreted(rows: Iterator[Row], source: RadioSource, known: KnownRobots) -> tuple[WirelessLog, Account]:
    return interpret(rows, source, known, source.described())


def _refuse_settings(source: RadioSource, what: str, more: set[str]) -> None:
    """Settings that would change nothing are mistakes.

    Raises:
        ConfigError: there are some; names them.
    """
    known = CORRECTIONS | more
    if unused := sorted(source.model_fields_set - known - {"path", "kind", "preset"}):
        names = ", ".join(RadioSource.model_fields[name].alias or name for name in unused)
        raise ConfigError(f"{source.described()}: {what} cannot use {names}; known: {', '.join(sorted(known))}")


def _renamed(log: WirelessLog, source: RadioSource, known: KnownRobots) -> WirelessLog:
    """A log that names robots and states units itself, corrected by what the source says besides."""
    return corrected(log, source, TagNames(source, known if source.robots == "by number" else None))
