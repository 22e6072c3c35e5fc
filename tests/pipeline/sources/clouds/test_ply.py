"""PLY: ASCII and both byte orders, scalars, elements before the vertices, damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.clouds.ply import read_ply

NAMES = {"f4": "float", "f8": "double", "u1": "uchar", "u4": "uint", "i2": "int16"}
FIELDS = {"x": "f4", "y": "f8", "z": "f4", "scalar_intensity": "u1", "time": "f8", "nx": "f4", "ring": "i2"}


def ply_bytes(how: str, count: int = 60, *, before: bytes = b"", head: str = "") -> tuple[bytes, np.ndarray]:
    order = ">" if how == "binary_big_endian" else "<"
    rows = np.zeros(count, [(name, order + of) for name, of in FIELDS.items()])
    for number, name in enumerate(FIELDS):
        rows[name] = np.arange(1, count + 1) * (number + 1) % 97 + 1
    properties = "".join(f"property {NAMES[of]} {name}\n" for name, of in FIELDS.items())
    text = f"ply\nformat {how} 1.0\ncomment made by a test\n{head}element vertex {count}\n{properties}"
    text += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    if how == "ascii":
        body = before + "".join(" ".join(map(str, row)) + "\n" for row in rows.tolist()).encode() + b"3 0 1 2\n"
    else:
        body = before + rows.tobytes() + b"\3" + bytes(12)
    return text.encode() + body, rows


@pytest.mark.parametrize("how", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("count", [0, 60])
def test_scalars_of_every_kind(tmp_path: Path, how: str, count: int) -> None:
    content, rows = ply_bytes(how, count)
    (tmp_path / "a.ply").write_bytes(content)
    cloud = read_ply(tmp_path / "a.ply")
    np.testing.assert_array_equal(cloud.points, np.column_stack([rows[axis] for axis in "xyz"]))
    np.testing.assert_array_equal(cloud.intensity, rows["scalar_intensity"])
    np.testing.assert_array_equal(cloud.times, rows["time"])


@pytest.mark.parametrize("how", ["ascii", "binary_little_endian"])
def test_elements_before_the_vertices_are_passed_over(tmp_path: Path, how: str) -> None:
    before = b"0 0 1\n" if how == "ascii" else np.array([0, 0, 1], "<f4").tobytes()
    camera = "element camera 1\nproperty float vx\nproperty float vy\nproperty float vz\n"
    content, rows = ply_bytes(how, before=before, head=camera)
    (tmp_path / "a.ply").write_bytes(content)
    np.testing.assert_array_equal(read_ply(tmp_path / "a.ply").points[:, 0], rows["x"])


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (b"element vertex 60", b"element vertex 6000000000", "cut short"),
        (b"element vertex", b"element corner", "no vertices"),
        (b"property float x", b"property float a", "no field 'x'"),
        (b"property float x", b"property martian x", "no proper PLY header"),
        (b"format binary_little_endian", b"format base64", "no proper PLY header"),
        (b"end_header", b"end_footer", "no whole PLY header"),
        (b"property int16 ring", b"property list uchar int ring", "lists stand before"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: bytes, new: bytes, says: str) -> None:
    content, _ = ply_bytes("binary_little_endian")
    assert old in content
    (tmp_path / "a.ply").write_bytes(content.replace(old, new, 1))
    with pytest.raises(InputError, match=says) as caught:
        read_ply(tmp_path / "a.ply")
    assert "a.ply" in str(caught.value)


@pytest.mark.parametrize("how", ["ascii", "binary_little_endian", "binary_big_endian"])
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(places=st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), max_size=8), cut=st.floats(0.05, 1))
def test_damage_is_refused_or_read(tmp_path: Path, how: str, places: list[tuple[float, int]], cut: float) -> None:
    content = bytearray(ply_bytes(how)[0])
    for place, value in places:
        content[int(place * len(content))] = value
    (tmp_path / "a.ply").write_bytes(content[: int(cut * len(content))])
    try:
        cloud = read_ply(tmp_path / "a.ply")
    except InputError as error:
        assert "a.ply" in str(error)  # noqa: PT017
    else:
        assert np.isfinite(cloud.points).all()
