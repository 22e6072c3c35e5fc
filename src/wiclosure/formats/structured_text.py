"""YAML and JSON of unknown origin: the one place where either is parsed.

What a file may hold is bounded before objects are made of it: its size, how deep lists and mappings are nested, how
many values there are once YAML's aliases are expanded, how large numbers are.  A key that stands twice is an error:
both formats would let the last one win.

**YAML** is read so that ids stay what is written: `0010`, `0x1A`, `1_1`, `12:30` and `2024-01-02` are text.  YAML 1.1,
which PyYAML reads, makes numbers to bases 8, 16 and 60 of them, and dates; tags of radios have such ids.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Hashable
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import yaml

from wiclosure.errors import InputError

DEEPEST = 64
"""Lists and mappings in each other; robots' settings need 5, JSON Robot Logs 8."""
MOST_VALUES = 200_000
"""In a YAML file, with aliases expanded: settings, data sets, metadata of bags."""
LARGEST_YAML = 4 * 2**20
LARGEST_JSON = 2**30
"""Bytes; what a pose graph of some millions of edges takes."""
_MOST_DIGITS = 20  # of a whole number: 64 bits
_LARGEST_POWER = 400  # of ten, of a decimal: float64 ends at 308

_NOT_MADE = (ValueError, ArithmeticError, LookupError, TypeError, AttributeError, RecursionError)
"""What the libraries raise for values that are none, as `!!int x`."""


# ---------------------------------------------------------------------------------------------------------------- YAML
_INT, _FLOAT, _DATE = "tag:yaml.org,2002:int", "tag:yaml.org,2002:float", "tag:yaml.org,2002:timestamp"
_MERGE = "tag:yaml.org,2002:merge"
_WHOLE = re.compile(rf"[-+]?(?:0|[1-9][0-9]{{0,{_MOST_DIGITS - 3}}})$")  # longer ones are ids
_DECIMAL = re.compile(
    r"[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?$|[-+]?\.(?:inf|Inf|INF)$|\.(?:nan|NaN|NAN)$"
)
if TYPE_CHECKING:
    from yaml import SafeLoader as _SafeLoader
else:
    _SafeLoader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the first where libyaml is there


class _Loader(_SafeLoader):
    """PyYAML's safe loader with decimal numbers alone, and every key once."""


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in {_INT, _FLOAT, _DATE}]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_implicit_resolver(_FLOAT, _DECIMAL, list("-+0123456789."))
_Loader.add_implicit_resolver(_INT, _WHOLE, list("-+0123456789"))


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Hashable, Any]:
    seen: set[Hashable] = set()
    for key_node, _ in node.value:
        if key_node.tag == _MERGE:
            continue
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, Hashable):
            raise yaml.constructor.ConstructorError(None, None, "a key is a list or mapping", key_node.start_mark)
        if key in seen:
            raise yaml.constructor.ConstructorError(
                None, None, f"{key!r} stands twice; give it once", key_node.start_mark
            )
        seen.add(key)
    made: dict[Hashable, Any] = loader.construct_mapping(node, deep=True)
    return made


def _number(loader: _Loader, node: yaml.ScalarNode) -> float:
    value = float(loader.construct_yaml_float(node))
    if math.isinf(value) and "inf" not in node.value.lower():
        raise yaml.constructor.ConstructorError(None, None, f"{node.value[:40]} is too large", node.start_mark)
    return value


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)
_Loader.add_constructor(_FLOAT, _number)


def parse_yaml(text: str) -> Any:
    """What the text holds.

    Raises:
        InputError: it is no YAML, or holds more than settings can; names the line, and not the place.
    """
    if len(text) > LARGEST_YAML:
        raise InputError(f"more than {LARGEST_YAML >> 20} MB of YAML: no settings are so long")
    try:
        _check_extent(text)
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"line {mark.line + 1}: " if mark else ""
        is_tab = mark is not None and "".join(text.splitlines()[mark.line : mark.line + 1])[mark.column :].startswith(
            "\t"
        )
        way_out = "; indent by spaces, not by tabs" if is_tab else ""
        raise InputError(f"{line}{error.problem or 'not valid YAML'}{way_out}") from error
    except yaml.YAMLError as error:
        raise InputError(f"not valid YAML: {_in_one_line(error)}") from error
    except _NOT_MADE as error:
        raise InputError(f"not valid YAML: a value cannot be made ({_in_one_line(error)})") from error


def read_yaml(path: Path) -> Any:
    """What a YAML file holds.

    Raises:
        InputError: it cannot be read, or see `parse_yaml`; names the file and the line.
    """
    text = _text(path, LARGEST_YAML, "YAML")
    try:
        return parse_yaml(text)
    except InputError as error:
        raise InputError(f"{path}{', ' if str(error).startswith('line ') else ': '}{error}") from error


def _check_extent(text: str) -> None:
    """Refuses nesting and aliases beyond all use, by the parser's events: before anything is made of them."""
    anchors: dict[str, tuple[int, int]] = {}
    open_nodes = [_Open(None)]  # the document, and what is not closed yet
    for event in yaml.parse(text, _SafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            open_nodes.append(_Open(event.anchor, size=1))
            extent = (0, 0)
        elif isinstance(event, yaml.CollectionEndEvent):
            closed = open_nodes.pop()
            extent = (closed.size, closed.height + 1)
            anchors[closed.anchor or ""] = extent
        elif isinstance(event, yaml.NodeEvent):
            extent = _extent_of(event, anchors)
        else:
            continue
        open_nodes[-1].take(extent)
        if len(open_nodes) - 1 + extent[1] > DEEPEST:
            raise _refused(event, f"lists or mappings are nested deeper than {DEEPEST}")
        if open_nodes[-1].size > MOST_VALUES:
            raise _refused(event, f"more than {MOST_VALUES} values, with what *aliases stand for")


@dataclass(slots=True)
class _Open:
    """A list or mapping: its anchor, how many values it holds so far, and how deep they are."""

    anchor: str | None
    size: int = 0
    height: int = 0

    def take(self, extent: tuple[int, int]) -> None:
        self.size += extent[0]
        self.height = max(self.height, extent[1])


def _extent_of(event: yaml.NodeEvent, anchors: dict[str, tuple[int, int]]) -> tuple[int, int]:
    """How many values a scalar or an alias stands for, and how deep they are."""
    if isinstance(event, yaml.AliasEvent):
        if event.anchor not in anchors:
            raise _refused(event, f"*{event.anchor} stands for nothing above, or for what it is part of")
        return anchors[event.anchor]
    if isinstance(event, yaml.ScalarEvent) and "\0" in event.value:
        raise _refused(event, "a zero byte in a text")
    if event.anchor is not None:
        anchors[event.anchor] = (1, 0)
    return 1, 0


def _refused(event: yaml.Event, why: str) -> InputError:
    return InputError(f"line {event.start_mark.line + 1}: {why}" if event.start_mark else why)


# ---------------------------------------------------------------------------------------------------------------- JSON
def parse_json(content: bytes | str, *, exact: bool = False) -> Any:
    """What the text holds.

    Args:
        content: text, or bytes in UTF-8.
        exact: decimals become `Decimal`, so that nothing is lost; floats otherwise.

    Raises:
        InputError: it is no JSON, or nested deeper, or with larger numbers, than anything is; does not name the place.
    """
    raw = content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content
    if len(raw) > LARGEST_JSON:
        raise InputError(f"more than {LARGEST_JSON >> 20} MB of JSON")
    if raw.count(b"[") + raw.count(b"{") > DEEPEST and _depth(raw) > DEEPEST:
        raise InputError(f"lists or objects are nested deeper than {DEEPEST}")
    if b"\\u0000" in raw:
        raise InputError("a text holds a zero byte")
    try:
        found = json.loads(
            raw.decode("utf-8-sig"),
            parse_float=_decimal if exact else _float,
            parse_int=_whole,
            object_pairs_hook=_object,
        )
        if _SURROGATE.search(raw):
            json.dumps(found, ensure_ascii=False, default=str).encode()
        return found
    except json.JSONDecodeError as error:
        line = f", line {error.lineno}" if error.lineno > 1 else ""
        raise InputError(f"not valid JSON ({error.msg}{line}, column {error.colno})") from error
    except UnicodeDecodeError as error:
        raise InputError(f"not valid JSON (byte {error.start} is not UTF-8)") from error
    except UnicodeEncodeError as error:
        raise InputError("not valid JSON (a text holds half of a character)") from error
    except _NOT_MADE as error:
        raise InputError(f"not valid JSON ({_in_one_line(error)})") from error


def read_json(path: Path) -> Any:
    """What a JSON file holds.

    Raises:
        InputError: it cannot be read, or see `parse_json`; names the file.
    """
    text = _text(path, LARGEST_JSON, "JSON")
    try:
        return parse_json(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


_DEEPER = np.zeros(256, np.int8)
_DEEPER[[*b"[{"]], _DEEPER[[*b"]}"]] = 1, -1
_SURROGATE = re.compile(rb"\\u[dD][89a-fA-F]")
_STRING = re.compile(rb'"(?:[^"\\]|\\.)*"?', re.DOTALL)


def _depth(raw: bytes) -> int:
    """How deep lists and objects stand in each other."""
    steps = _DEEPER[np.frombuffer(_STRING.sub(b"", raw), np.uint8)]
    return int(np.cumsum(steps[steps != 0], dtype=np.int64).max(initial=0))


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in found if keys.count(key) > 1)
        raise ValueError(f"{twice[:40]!r} stands twice in one object")
    return found


def _whole(digits: str) -> int:
    if len(digits) > _MOST_DIGITS + 1:
        _too_large(digits)
    return int(digits)


def _float(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        _too_large(text)
    return value


def _decimal(text: str) -> Decimal:
    value = Decimal(text)
    if abs(value.adjusted()) > _LARGEST_POWER:
        _too_large(text)
    return value


def _too_large(text: str) -> NoReturn:
    raise ValueError(f"{text[:30]}{'...' if len(text) > 30 else ''} is too large or small; expected a finite number")


def _text(path: Path, largest: int, kind: str) -> str:
    try:
        with path.open("rb") as file:
            raw = file.read(largest + 1)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; check the path") from error
    if len(raw) > largest:
        raise InputError(f"{path} holds more than {largest >> 20} MB of {kind}; is it another file?")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not {kind}: byte {error.start} is no UTF-8 text; save it as UTF-8") from error


def _in_one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
