from __future__ import annotations

import bz2
import gzip
import lzma
import resource
import zipfile
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.unpacking import (
    LARGEST_BLOCK,
    ZSTD_MAGIC,
    Compression,
    UnpackError,
    read_arrays,
    unpack,
    unpack_file,
    zstd,
)

DATA = np.random.default_rng(0).integers(0, 40, 400_000, np.uint8).tobytes()
PACKERS: dict[Compression, Callable[[bytes], bytes]] = {
    "zstd": zstd.compress, "lz4": lz4.frame.compress, "bz2": bz2.compress, "gz": gzip.compress, "xz": lzma.compress
}  # fmt: skip
every = pytest.mark.parametrize("compression", PACKERS)


@every
def test_whole_frames(compression: Compression) -> None:
    packed = PACKERS[compression](DATA)
    assert unpack(packed, compression) == unpack(packed, compression, partly=True) == DATA
    assert unpack(packed, compression, len(DATA)) == DATA
    assert unpack(packed * 2, compression) == DATA * 2
    assert packed.startswith(ZSTD_MAGIC) == (compression == "zstd")


@every
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_cut_frame_gives_its_beginning(compression: Compression, share: float) -> None:
    packed = PACKERS[compression](DATA)
    cut = packed[: int(share * len(packed))]
    assert DATA.startswith(unpack(cut, compression, partly=True))
    with pytest.raises(UnpackError, match="are cut"):
        unpack(cut, compression)


@every
def test_more_than_expected_is_refused_and_takes_no_memory(compression: Compression) -> None:
    piece = PACKERS[compression](bytes(2**24))
    bomb = piece * (2**29 // 2**24)  # twice what is taken
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(UnpackError, match="unpack to more than 256 MB"):
        unpack(bomb, compression)
    with pytest.raises(UnpackError, match="unpack to more than 399999 bytes"):
        unpack(PACKERS[compression](DATA), compression, len(DATA) - 1)
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024 < 2.5 * LARGEST_BLOCK


@every
def test_what_is_no_frame_is_an_error(compression: Compression) -> None:
    with pytest.raises(UnpackError, match="are damaged"):
        unpack(b"no frame at all, but some other bytes", compression, partly=True)


def test_files_are_unpacked_as_far_as_they_go(tmp_path: Path) -> None:
    packed, source, target = zstd.compress(DATA), tmp_path / "a.zst", tmp_path / "a"
    for share in (0.3, 0.9, 1):
        source.write_bytes(packed[: int(share * len(packed))])
        unpack_file(source, target)
        assert DATA.startswith(target.read_bytes())
    assert target.read_bytes() == DATA
    source.write_bytes(zstd.compress(bytes(2**25)) * 9)
    with pytest.raises(UnpackError, match=r"a\.zst unpacks to more than 256 MB"):
        unpack_file(source, target)


def test_no_room_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.zst").write_bytes(zstd.compress(DATA))
    with pytest.raises(OutputError, match=r"no room to unpack .*a\.zst.*set TMPDIR"):
        unpack_file(tmp_path / "a.zst", Path("/dev/full"))


def test_arrays_are_read_as_they_were_written(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, numbers=np.arange(5), words=np.array(["a", "b"]))
    assert {name: array.tolist() for name, array in read_arrays(path).items()} == {
        "numbers": [0, 1, 2, 3, 4], "words": ["a", "b"]
    }  # fmt: skip
    content = path.read_bytes()
    path.write_bytes(content[:-40])
    with pytest.raises(InputError, match=r"a\.npz is damaged"):
        read_arrays(path)
    np.savez_compressed(path, zeros=np.zeros(10**6))
    with pytest.raises(InputError, match=r"a\.npz is compressed"):
        read_arrays(path)
    np.savez(path, harm=np.array([{"any": "object"}], object), allow_pickle=True)
    with pytest.raises(InputError, match=r"a\.npz is damaged"):
        read_arrays(path)
    with zipfile.ZipFile(path, "w") as pack:
        header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999,), }".ljust(117) + b"\n"
        pack.writestr("a.npy", b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(InputError, match=r"a\.npz is damaged"):
        read_arrays(path)
