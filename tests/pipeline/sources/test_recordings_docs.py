"""docs/recordings.md: each row of its tables holds."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline.sources.clouds.bin import LAYOUTS, record_type
from wiclosure.pipeline.sources.messages.field_names import intensity_field, time_fields
from wiclosure.pipeline.sources.poses.pose_topics import POSE_TYPES
from wiclosure.pipeline.sources.scan_topics import SCAN_TYPES

from .messages.test_pointcloud2 import SWEEP, Cloud, decode, xyz

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "recordings.md").read_text(encoding="utf-8")


def column(heading: str, number: int = 0) -> list[str]:
    """The words in backticks in one column of the table whose heading begins so."""
    table = PAGE[PAGE.index(f"\n| {heading}") :].split("\n\n")[0].splitlines()[3:]
    return [word for row in table for word in re.findall(r"`([^`]+)`", row.split("|")[number + 1])]


@pytest.mark.parametrize("name", column("field"))
@pytest.mark.parametrize("case", [str, str.upper, str.title])
def test_every_name_of_times_deskews(name: str, case: type[str]) -> None:
    times = SWEEP * 0.1
    scan = decode(Cloud(xyz(SWEEP.shape) | {case(name): times.astype("f4")}))
    assert scan.times is not None
    np.testing.assert_allclose(scan.times, times[0], atol=1e-7)
    assert time_fields([f"{name}_ns"]) == [f"{name}_ns"]


def test_names_of_intensity() -> None:
    line = next(line for line in PAGE.splitlines() if line.startswith("Intensity is read from"))
    names = re.findall(r"`([^`]+)`", line)
    assert len(names) >= 7
    assert [intensity_field(["x", name]) for name in names] == names


def test_layouts() -> None:
    assert dict(zip(column("`layout`"), column("`layout`", 1), strict=True)) == dict(LAYOUTS)
    rows = PAGE[PAGE.index("\n| `layout`") :].split("\n\n")[0].splitlines()[3:]
    assert [int(row.split("|")[3]) for row in rows] == [record_type(name).itemsize for name in LAYOUTS]


def test_types_of_topics() -> None:
    assert set(column("type")) <= set(SCAN_TYPES)
    others = {re.sub(r"/.*", "", msgtype) for msgtype in SCAN_TYPES} - {re.sub(r"/.*", "", t) for t in column("type")}
    assert others == {"livox_ros_driver2", "livox_interfaces", "livox_interfaces2"}
    of_poses = set(column("topic")) | {"tf/msg/tfMessage"}
    assert of_poses == set(POSE_TYPES)
