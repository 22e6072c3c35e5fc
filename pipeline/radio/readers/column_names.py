"""Which column means what, by the names that loggers give them."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from wiclosure.errors import InputError
from wiclosure.pipeline.radio.source import RadioSource

logger = logging.getLogger(__name__)

_UNITS: Mapping[str, tuple[str, ...]] = {
    "unit": ("m", "mm", "cm", "ft", "in", "meters", "metres", "meter", "metre", "feet", "inches", "inch"),
    "stamp_unit": ("s", "ms", "us", "ns", "sec", "secs", "seconds"),
    "angle_unit": ("rad", "deg", "degrees", "radians"),
}
_SHORT = {
    **dict.fromkeys(("meters", "metres", "meter", "metre"), "m"),
    **dict.fromkeys(("sec", "secs", "seconds"), "s"),
    **dict.fromkeys(("inches", "inch"), "in"),
    "feet": "ft",
    "degrees": "deg",
    "radians": "rad",
}
_NAMES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "stamp": ("stamp_unit", ("stamp", "timestamp", "time", "t", "ts", "%time", "ros_time", "unix_time", "epoch",
                             "datetime", "time_stamp", "host_time", "field.header.stamp", "header.stamp")),
    "range": ("unit", ("range", "distance", "dist", "dis", "d", "r", "uwb", "uwb_range", "field.range", "measurement")),
    "range_sigma": ("unit", ("range_sigma", "sigma", "std", "range_std", "stddev", "sigma_range")),
    "from": ("", ("from", "from_id", "src", "src_id", "source", "receiver", "tag", "tag_id", "origin_id", "initiator",
                  "own_id", "self_id", "robot", "robot_id", "tag_a", "id_a", "node_a", "a", "id1", "uwb_id1")),
    "to": ("", ("to", "to_id", "dst", "dst_id", "dest", "destination", "destination_id", "transmitter", "anchor",
                "anchor_id", "responder", "target", "target_id", "peer", "peer_id", "remote_id", "other", "tag_b",
                "id_b", "node_b", "b", "id2", "uwb_id2", "neighbor", "neighbour")),
    "azimuth": ("angle_unit", ("azimuth", "az", "bearing", "aoa", "angle", "azimuth_angle")),
    "elevation": ("angle_unit", ("elevation", "el", "elevation_angle")),
}  # fmt: skip


def guessed_fields(
    columns: Sequence[str], source: RadioSource, path: Path, *, has_header: bool, units: Sequence[str] = ()
) -> RadioSource:
    """The source, with columns that it does not name found by their own names; `units` are those of the columns.

    Raises:
        InputError: no column of times, or neither one of ranges nor of bearings, is named or known.
    """
    stated = {RadioSource.model_fields[name].alias or name for name in source.model_fields_set}
    found = {key: value for key, value in guess(columns, units).items() if key not in stated} if has_header else {}
    if source.receiver is not None:
        found.pop("from", None)
    if source.transmitter is not None:
        found.pop("to", None)
    if stated & {"range", "azimuth", "x"}:  # what is measured is named: nothing else is taken for a measurement
        found = {key: value for key, value in found.items() if key in {"stamp", "stamp_unit", "from", "to"}}
    complete = source.model_copy(update={_attribute(key): _value(key, value) for key, value in found.items()})
    shown = f"its columns: {', '.join(columns[:20])}"
    example = "name it with stamp: (a name, or a number from 1)"
    if len(columns) == 1:
        example = "say what stands between the cells by delimiter:, or read lines by pattern:"
    if not complete.stamp:
        raise InputError(f"{path}: no column of times is known; {example}; {shown}")
    if not (complete.range_ or complete.azimuth or complete.x):
        raise InputError(
            f"{path}: no column of ranges is known; name it with range:, or azimuth:{_family(columns)}; {shown}"
        )
    if not complete.range_sigma and (apart := _sigmas_apart(columns, complete.unit)) and has_header:
        logger.warning(
            "%s: column %s is not in the unit of the ranges (%s) and is not used; state range_sigma in metres",
            path, apart[0], complete.unit,
        )  # fmt: skip
    if found:
        logger.info(
            "%s: read by the names of its columns as %s", path, ", ".join(f"{k}: {v}" for k, v in found.items())
        )
    return complete


def guess(columns: Sequence[str], units: Sequence[str] = ()) -> dict[str, Any]:
    """Settings that the names of columns suggest: `distance_mm` is a range in millimetres.

    Args:
        columns: names.
        units: of the columns, where a line of the table states them.
    """
    found: dict[str, Any] = {}
    taken: set[str] = set()
    if times := _two_columns_of_time(columns):
        found["stamp"] = times
        taken.update(times)
    stated = dict(zip(columns, units, strict=False))
    if {"ax", "ay"} & {column.strip().casefold() for column in columns}:
        taken.update(column for column in columns if column.strip().casefold() == "az")  # an acceleration
    for key, (unit_key, names) in _NAMES.items():
        for column in columns:
            if key in found:
                break
            base, unit = _split(column, unit_key)
            unit = unit or _unit(stated.get(column, ""), unit_key)
            if base in names and column not in taken:
                if key == "range_sigma" and unit not in (None, found.get("unit", "m")):
                    continue  # it would be read in the unit of the ranges
                found[key] = column
                taken.add(column)
                if unit and unit_key not in found:
                    found[unit_key] = unit
                break
    return found


def _two_columns_of_time(columns: Sequence[str]) -> tuple[str, str] | None:
    """Seconds and nanoseconds, as `header.stamp.secs` and `header.stamp.nsecs`, or a date and a time of day."""
    plain = {_snake(column): column for column in columns}
    for name, column in plain.items():
        match = re.fullmatch(r"(.*?)(sec|secs|seconds|s)", name)
        for nano in ("nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds", "ns") if match else ():
            if match and (other := plain.get(match[1] + nano)) is not None and match[2][0] == "s":
                return column, other
    return (plain["date"], plain["time"]) if {"date", "time"} <= plain.keys() else None


def _family(columns: Sequence[str]) -> str:
    """How columns are named together whose names differ in their numbers, as a hint."""
    shapes: dict[str, list[str]] = {}
    for column in columns:
        shapes.setdefault(re.sub(r"\d+", "#", column), []).append(column)
    shape = max((shape for shape in shapes if "#" in shape), key=lambda shape: len(shapes[shape]), default="")
    if len(shapes.get(shape, ())) < 2 or shape.count("#") > 2:
        return ""
    family = shape.replace("#", "{to}") if shape.count("#") == 1 else shape.replace("#", "{from}", 1)
    return f", several columns together as range: '{family.replace('#', '{to}')}'"


def _sigmas_apart(columns: Sequence[str], range_unit: str) -> list[str]:
    """Columns of standard deviations whose names state another unit than that of the ranges."""
    split = {column: _split(column, "unit") for column in columns}
    return [
        name for name, (base, of) in split.items() if base in _NAMES["range_sigma"][1] and of not in (None, range_unit)
    ]


def _split(column: str, unit_key: str) -> tuple[str, str | None]:
    """`Distance [mm]` as `distance` and `mm`."""
    plain = _snake(column)
    if not unit_key:
        return re.sub(r"\s+", "_", plain), None
    units = "|".join(sorted(_UNITS[unit_key], key=len, reverse=True))
    match = re.fullmatch(rf"(.+?)\s*(?:_|\s|\(|\[)\s*({units})\s*[)\]]?", plain)
    base, unit = (match[1], match[2]) if match else (plain, None)
    return re.sub(r"\s+", "_", base), None if unit is None else _SHORT.get(unit, unit)


def _unit(word: str, unit_key: str) -> str | None:
    """The unit that a word means among those of a kind."""
    return _SHORT.get(word, word) if unit_key and word in _UNITS[unit_key] else None


def _snake(column: str) -> str:
    """`rangeMeters` as `range_meters`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", column.strip()).casefold()


def _attribute(key: str) -> str:
    return f"{key}_" if key in {"from", "range"} else key


def _value(key: str, value: object) -> object:
    return (value,) if key in {"stamp", "range"} and isinstance(value, str) else value
