"""Wireless logs, written: JSON Lines as `wiclosure.formats.radio.wireless_log` reads them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from wiclosure.errors import OutputError
from wiclosure.formats.stamps import seconds_text
from wiclosure.types import Heading, WirelessLog, WirelessMeasurement


def write_wireless_log(path: Path | str, log: WirelessLog) -> None:
    """Writes a wireless log in order of time; reading it again gives an equal log.

    Raises:
        OutputError: the file cannot be written.
    """
    records = [(m.stamp_ns, _measurement_line(m)) for m in log.measurements]
    records += [(h.stamp_ns, _heading_line(h)) for h in log.headings]
    records.sort(key=lambda record: record[0])
    try:
        Path(path).write_text("".join(f"{line}\n" for _, line in records), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write the wireless log {path}: {error.strerror}; check the folder") from error


def _measurement_line(measurement: WirelessMeasurement) -> str:
    fields: dict[str, object] = {
        "receiver": measurement.receiver,
        "transmitter": measurement.transmitter,
        "range": measurement.range_m,
        "range_sigma": measurement.range_sigma_m,
        "aoa_frame": measurement.aoa_frame,
        "paths": [
            {"azimuth": p.azimuth, "elevation": p.elevation, "sigma": p.sigma, "weight": p.weight}
            for p in measurement.paths
        ]
        or None,
    }
    for key, arm in (
        ("lever_arm_receiver", measurement.lever_arm_receiver),
        ("lever_arm_transmitter", measurement.lever_arm_transmitter),
    ):
        if any(arm):
            fields[key] = arm
    stamps = {"stamp": measurement.stamp_ns}
    if measurement.transmitter_stamp_ns is not None:
        stamps["transmitter_stamp"] = measurement.transmitter_stamp_ns
    return _line("wireless", stamps, fields)


def _heading_line(heading: Heading) -> str:
    return _line(
        "heading",
        {"stamp": heading.stamp_ns},
        {"robot": heading.robot, "heading": heading.heading, "sigma": heading.sigma},
    )


def _line(kind: str, stamps_ns: Mapping[str, int], fields: Mapping[str, object]) -> str:
    """One record; stamps are spelt out because JSON's floats cannot hold nanoseconds since 1970."""
    stamps = ",".join(f'"{key}":{text}' for key, text in zip(stamps_ns, seconds_text(stamps_ns.values()), strict=True))
    return f'{{"type":"{kind}",{stamps},{json.dumps(fields, separators=(",", ":"), allow_nan=False)[1:]}'
