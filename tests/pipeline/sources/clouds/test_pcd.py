"""PCD: all three encodings, padding, counts, types, empty files, damage."""

from __future__ import annotations

import struct
from pathlib import Path

import lzf
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.pcd import read_pcd

Field = tuple[str, str, int]  # name, NumPy's type, COUNT

XYZI = (("x", "f4", 1), ("y", "f4", 1), ("z", "f4", 1), ("intensity", "f4", 1))
BAG_TO_PCD = (*XYZI[:3], ("_", "u1", 4), XYZI[3], ("_", "u1", 12), ("ring", "u2", 1), ("time", "f8", 1), ("_", "i1", 2))
HISTOGRAM = (*XYZI, ("fpfh", "f4", 33))
INTEGERS = (("x", "i2", 1), ("y", "i4", 1), ("z", "f8", 1), ("t", "u4", 1), ("reflectivity", "u1", 1))
ENCODINGS = ["ascii", "binary", "binary_compressed"]


def columns_of(fields: tuple[Field, ...], points: int) -> list[np.ndarray]:
    rng = np.random.default_rng(points)
    return [rng.integers(1, 100, (points, count)).astype("<" + of) for _, of, count in fields]


def pcd_bytes(fields: tuple[Field, ...], columns: list[np.ndarray], encoding: str) -> bytes:
    points = len(columns[0])
    kinds = {"f": "F", "i": "I", "u": "U"}
    head = "\n".join(
        [
            "# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7",
            "FIELDS " + " ".join(name for name, _, _ in fields),
            "SIZE " + " ".join(of[1] for _, of, _ in fields),
            "TYPE " + " ".join(kinds[of[0]] for _, of, _ in fields),
            "COUNT " + " ".join(str(count) for *_, count in fields),
            f"WIDTH {points}", "HEIGHT 1", "VIEWPOINT 0 0 0 1 0 0 0", f"POINTS {points}", f"DATA {encoding}", "",
        ]
    ).encode()  # fmt: skip
    if encoding == "ascii":
        rows = [[repr(value) for column in columns for value in column[row].tolist()] for row in range(points)]
        return head + "\n".join(map(" ".join, rows)).encode() + b"\n"
    if encoding == "binary":
        return head + b"".join(column[row].tobytes() for row in range(points) for column in columns)
    plain = b"".join(column.tobytes() for column in columns)
    packed = lzf.compress(plain, 2 * len(plain) + 64) or b"" if plain else b""
    return head + struct.pack("<II", len(packed), len(plain)) + packed


@pytest.mark.parametrize("fields", [XYZI, BAG_TO_PCD, HISTOGRAM, INTEGERS])
@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("points", [0, 1, 500])
def test_every_layout_in_every_encoding(tmp_path: Path, fields: tuple[Field, ...], encoding: str, points: int) -> None:
    columns = columns_of(fields, points)
    (tmp_path / "a.pcd").write_bytes(pcd_bytes(fields, columns, encoding))
    cloud = read_pcd(tmp_path / "a.pcd")
    by_name = {name: column for (name, _, _), column in zip(fields, columns, strict=True)}
    np.testing.assert_array_equal(cloud.points, np.hstack([by_name[axis] for axis in "xyz"]))
    assert cloud.intensity is not None
    np.testing.assert_array_equal(cloud.intensity, by_name.get("intensity", by_name.get("reflectivity"))[:, 0])  # type: ignore[index]
    times = by_name.get("time", by_name.get("t"))
    if times is not None:
        assert cloud.times is not None
        np.testing.assert_array_equal(cloud.times, times[:, 0])


def test_windows_line_ends_lower_case_and_no_count(tmp_path: Path) -> None:
    head = ["version .7", "fields X Y Z", "size 4 4 4", "type F F F", "width 2", "height 1", "data ascii"]
    (tmp_path / "a.pcd").write_bytes("\r\n".join([*head, "1 2 3", "nan 1 1", ""]).encode())
    np.testing.assert_array_equal(read_pcd(tmp_path / "a.pcd").points, [[1, 2, 3]])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b"FIELDS x y z", b"FIELDS a y z", "no field 'x'"),
        (b"FIELDS", b"FELDS", "no proper PCD header .'FIELDS'"),
        (b"SIZE 4", b"SIZE 3", "unknown type F3"),
        (b"POINTS 50", b"POINTS 99999999999", "cut short"),
        (b"POINTS 50", b"POINTS -1", "negative"),
        (b"COUNT 1", b"COUNT 2", "one number each"),
        (b"DATA binary", b"DATA martian", "expected ascii"),
        (b"DATA binary", b"DATA_binary", "no whole PCD header"),
        (b"TYPE F F F F", b"TYPE F F F", "differ in number"),
        (b"WIDTH 50\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 50", b"POINTS many", "no proper PCD header"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: bytes, new: bytes, says: str) -> None:
    content = pcd_bytes(XYZI, columns_of(XYZI, 50), "binary")
    assert old in content
    (tmp_path / "a.pcd").write_bytes(content.replace(old, new, 1))
    with pytest.raises(InputError, match=says) as caught:
        read_pcd(tmp_path / "a.pcd")
    assert "a.pcd" in str(caught.value)


@pytest.mark.parametrize("encoding", ENCODINGS)
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(places=st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), max_size=8), cut=st.floats(0.05, 1))
def test_damage_is_refused_or_read(tmp_path: Path, encoding: str, places: list[tuple[float, int]], cut: float) -> None:
    content = bytearray(pcd_bytes(BAG_TO_PCD, columns_of(BAG_TO_PCD, 40), encoding))
    for place, value in places:
        content[int(place * len(content))] = value
    (tmp_path / "a.pcd").write_bytes(content[: int(cut * len(content))])
    try:
        cloud = read_pcd(tmp_path / "a.pcd")
    except InputError as error:
        assert "a.pcd" in str(error)  # noqa: PT017
    else:
        assert np.isfinite(cloud.points).all()
