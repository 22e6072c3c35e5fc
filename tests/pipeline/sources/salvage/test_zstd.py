from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline.sources.salvage import zstd

DATA = np.random.default_rng(0).integers(0, 40, 400_000, np.uint8).tobytes()


@pytest.fixture(scope="module")
def packed() -> bytes:
    return zstd.zstd.compress(DATA)


def test_a_whole_frame(packed: bytes) -> None:
    assert packed.startswith(zstd.ZSTD_MAGIC)
    assert zstd.decompress(packed) == zstd.decompress_partly(packed) == DATA


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_cut_frame_gives_its_beginning(packed: bytes, share: float, tmp_path: Path) -> None:
    cut = packed[: int(share * len(packed))]
    found = zstd.decompress_partly(cut)
    assert DATA.startswith(found)
    assert len(found) > (share - 0.4) * len(DATA)
    with pytest.raises((zstd.ZstdError, EOFError)):
        zstd.decompress(cut)
    (tmp_path / "a.zst").write_bytes(cut)
    zstd.decompress_file(tmp_path / "a.zst", tmp_path / "a")
    assert DATA.startswith((tmp_path / "a").read_bytes())


def test_a_file_is_unpacked(packed: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.zst").write_bytes(packed)
    zstd.decompress_file(tmp_path / "a.zst", tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == DATA


def test_what_is_no_frame_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"."):
        zstd.decompress_partly(b"no frame at all")
