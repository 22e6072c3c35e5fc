from __future__ import annotations

import bz2
import gzip
import io
import lzma
import sys
import zipfile
from pathlib import Path

import pytest

from wiclosure.backends.graph_files.open import begins_as_json, read_bytes, read_text, stem
from wiclosure.errors import InputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

TEXT = "EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n"


@pytest.mark.parametrize(
    ("name", "pack"),
    [("a.g2o", bytes), ("a.g2o.gz", gzip.compress), ("a.g2o.XZ", lzma.compress),
     ("a.g2o.bz2", bz2.compress), ("a.g2o.zst", zstd.compress)],
)  # fmt: skip
def test_packed_and_plain_files_hold_the_same_text(tmp_path: Path, name: str, pack) -> None:
    (tmp_path / name).write_bytes(pack(b"\xef\xbb\xbf" + TEXT.encode()))
    assert read_text(tmp_path / name) == TEXT  # without the mark that some editors put first


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress, bz2.compress, zstd.compress])
def test_a_packed_file_is_known_by_its_first_bytes_whatever_its_name(tmp_path: Path, pack) -> None:
    (tmp_path / "a.g2o").write_bytes(pack(TEXT.encode()))
    assert read_text(tmp_path / "a.g2o") == TEXT


def test_bytes_that_are_no_text_stand_for_no_number(tmp_path: Path) -> None:
    (tmp_path / "a.g2o").write_bytes(b"1\xff2")
    assert read_text(tmp_path / "a.g2o") == "1\ufffd2"
    assert read_bytes(tmp_path / "a.g2o") == b"1\xff2"


@pytest.mark.parametrize(("suffix", "pack"), [(".gz", gzip.compress), (".xz", lzma.compress)])
@pytest.mark.parametrize("damage", ["cut", "other"])
def test_damaged_packing_is_one_clear_line(tmp_path: Path, suffix: str, pack, damage: str) -> None:
    path = tmp_path / f"a.g2o{suffix}"
    packed = pack(TEXT.encode() * 100)
    path.write_bytes(packed[: len(packed) // 2] if damage == "cut" else TEXT.encode())
    with pytest.raises(
        InputError, match=rf"^cannot unpack the graph .*a\.g2o\{suffix}: the (gz|xz) data are (cut|damaged.*)$"
    ):
        read_bytes(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read the graph .*none\.g2o: No such file"):
        read_bytes(tmp_path / "none.g2o")


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("sphere.g2o.xz", "sphere"),
        ("team.jrl.cbor", "team"),
        ("run.2024.graph", "run.2024"),
        ("plain", "plain"),
        (".g2o", ".g2o"),
    ],
)
def test_the_stem_is_the_name_without_the_format(name: str, expected: str) -> None:
    assert stem(Path("folder") / name) == expected


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_read_as_utf_8_is(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.g2o").write_bytes(TEXT.encode(encoding))
    assert read_text(tmp_path / "a.g2o") == TEXT


def test_what_is_no_text_is_refused(tmp_path: Path) -> None:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("a.g2o", TEXT)
    (tmp_path / "a.zip").write_bytes(archive.getvalue())
    with pytest.raises(InputError, match=r"a\.zip holds no text; give the graph as text, packed at most as \.gz, \.xz"):
        read_text(tmp_path / "a.zip")


@pytest.mark.parametrize(("text", "is_json"), [("\ufeff {}", True), (TEXT, False), ("", False)])
def test_json_is_known_by_its_first_character(tmp_path: Path, text: str, is_json: bool) -> None:
    (tmp_path / "a.txt.gz").write_bytes(gzip.compress(text.encode()))
    assert begins_as_json(tmp_path / "a.txt.gz") is is_json
