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
    "unit": ("m", "mm", "cm", "ft", "meters", "metres", "meter", "metre"),
    "stamp_unit": ("s", "ms", "us", "ns", "sec", "secs", "seconds"),
    "angle_unit": ("rad", "deg", "degrees", "radians"),
}
_SHORT = {
    **dict.fromkeys(("meters", "metres", "meter", "metre"), "m"),
    **dict.fromkeys(("sec", "secs", "seconds"), "s"),
    "degrees": "deg",
    "radians": "rad",
}
_NAMES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "stamp": ("stamp_unit", ("stamp", "timestamp", "time", "t", "%time", "ros_time", "unix_time", "epoch", "datetime",
                             "host_time", "field.header.stamp", "header.stamp")),
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


def guessed_fields(columns: Sequence[str], source: RadioSource, path: Path, *, has_header: bool) -> RadioSource:
    """The source, with columns that it does not name found by their own names.

    Raises:
        InputError: no column of times, or neither one of ranges nor of bearings, is named or known.
    """
    stated = {RadioSource.model_fields[name].alias or name for name in source.model_fields_set}
    found = {key: value for key, value in guess(columns).items() if key not in stated} if has_header else {}
    if source.receiver is not None:
        found.pop("from", None)
    if source.transmitter is not None:
        found.pop("to", None)
    if stated & {"range", "azimuth", "x"}:  # what is measured is named: nothing else is taken for a measurement
        found = {key: value for key, value in found.items() if key in {"stamp", "stamp_unit", "from", "to"}}
    complete = source.model_copy(update={_attribute(key): _value(key, value) for key, value in found.items()})
    shown = f"its columns: {', '.join(columns[:20])}"
    example = "name it with stamp: (a name, or a number from 1)"
    if not complete.stamp:
        raise InputError(f"{path}: no column of times is known; {example}; {shown}")
    if not (complete.range_ or complete.azimuth or complete.x):
        raise InputError(f"{path}: no column of ranges is known; name it with range:, or azimuth:; {shown}")
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


def guess(columns: Sequence[str]) -> dict[str, Any]:
    """Settings that the names of columns suggest: `distance_mm` is a range in millimetres."""
    found: dict[str, Any] = {}
    taken: set[str] = set()
    if {"ax", "ay"} & {column.strip().casefold() for column in columns}:
        taken.update(column for column in columns if column.strip().casefold() == "az")  # an acceleration
    for key, (unit_key, names) in _NAMES.items():
        for column in columns:
            base, unit = _split(column, unit_key)
            if base in names and column not in taken:
                if key == "range_sigma" and unit not in (None, found.get("unit", "m")):
                    continue  # it would be read in the unit of the ranges
                found[key] = column
                taken.add(column)
                if unit and unit_key not in found:
                    found[unit_key] = unit
                break
    return found


def _sigmas_apart(columns: Sequence[str], range_unit: str) -> list[str]:
    """Columns of standard deviations whose names state another unit than that of the ranges."""
    split = {column: _split(column, "unit") for column in columns}
    return [
        name for name, (base, of) in split.items() if base in _NAMES["range_sigma"][1] and of not in (None, range_unit)
    ]


def _split(column: str, unit_key: str) -> tuple[str, str | None]:
    """`Distance [mm]` as `distance` and `mm`."""
    plain = column.strip().casefold()
    if not unit_key:
        return re.sub(r"\s+", "_", plain), None
    units = "|".join(sorted(_UNITS[unit_key], key=len, reverse=True))
    match = re.fullmatch(rf"(.+?)\s*(?:_|\s|\(|\[)\s*({units})\s*[)\]]?", plain)
    base, unit = (match[1], match[2]) if match else (plain, None)
    return re.sub(r"\s+", "_", base), None if unit is None else _SHORT.get(unit, unit)


def _attribute(key: str) -> str:
    return f"{key}_" if key in {"from", "range"} else key


def _value(key: str, value: str) -> object:
    return (value,) if key in {"stamp", "range"} else value
