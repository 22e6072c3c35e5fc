"""Decompression that ends: a file of some kilobytes may unpack to more than a machine holds.

One place for all that recordings, graphs and results are compressed by.  What comes out is bounded by what its file may
reasonably hold, before it is in memory.
"""

from __future__ import annotations

import bz2
import logging
import lzma
import sys
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, TypeAlias
from zipfile import ZIP_STORED

import numpy as np

from wiclosure.errors import InputError, OutputError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

logger = logging.getLogger(__name__)

Compression: TypeAlias = Literal["zstd", "lz4", "bz2", "gz", "xz"]

LARGEST_BLOCK = 2**28
"""Bytes of a chunk or message of a recording: ten times the clouds of the largest LiDARs."""
LARGEST_RATIO = 100
"""By how much whole files shrink at most: graphs 5, recordings 20."""
LARGEST_UNPACKED = 2**30
"""Bytes of a file that is unpacked in memory."""
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

_DAMAGE = (OSError, EOFError, ValueError, RuntimeError, MemoryError, zlib.error, lzma.LZMAError, zstd.ZstdError)
_PIECE = 2**24


def _lz4() -> Any:
    from lz4.frame import LZ4FrameDecompressor

    return LZ4FrameDecompressor()


_DECOMPRESSORS: Mapping[Compression, Callable[[], Any]] = {
    "zstd": zstd.ZstdDecompressor,
    "lz4": _lz4,
    "bz2": bz2.BZ2Decompressor,
    "gz": lambda: zlib.decompressobj(zlib.MAX_WBITS | 16),
    "xz": lzma.LZMADecompressor,
}


class UnpackError(InputError):
    """Compressed data that are damaged, or would be larger than anything reasonable; a sentence without their place."""


def unpack(data: bytes, compression: Compression, most: int = LARGEST_BLOCK, *, partly: bool = False) -> bytes:
    """What the data hold, of all frames that follow each other.

    Args:
        data: the compressed bytes.
        compression: by what.
        most: bytes that may come out.
        partly: of data that are cut, what is there.

    Raises:
        UnpackError: the data are damaged, or hold more.
    """
    parts: list[bytes] = []
    left = most
    while data:
        machine = _DECOMPRESSORS[compression]()
        try:
            part = bytes(machine.decompress(data, left + 1))
        except _DAMAGE as error:
            raise UnpackError(f"the {compression} data are damaged ({' '.join(str(error).split())[:100]})") from error
        left -= len(part)
        if left < 0:
            raise UnpackError(f"{compression} data unpack to more than {_size(most)}, which nothing here may hold")
        parts.append(part)
        if not machine.eof:
            if partly:
                break
            raise UnpackError(f"the {compression} data are cut")
        data = machine.unused_data
    return parts[0] if len(parts) == 1 else b"".join(parts)


def largest_content(packed: int) -> int:
    """Bytes that a whole file of so many compressed ones may hold."""
    return max(LARGEST_BLOCK, LARGEST_RATIO * packed)


def unpack_file(source: Path, target: Path) -> None:
    """Unpacks a file of Zstandard beside memory; of a cut one, what is there.

    Raises:
        UnpackError: it holds more than a file of its size may.
        OutputError: there is no room for it.
    """
    most = largest_content(source.stat().st_size)
    written = 0
    with target.open("wb") as file:
        try:
            with zstd.open(source, "rb") as packed:
                while piece := packed.read(_PIECE):
                    written += len(piece)
                    if written > most:
                        raise UnpackError(f"{source} unpacks to more than {_size(most)}, which no such recording holds")
                    _write(file.write, piece, source, target)
        except (EOFError, zstd.ZstdError) as error:
            logger.info("%s: %s", source, error)


def read_arrays(path: Path) -> dict[str, Any]:
    """All arrays of a `.npz` file that `numpy.savez` wrote, which compresses nothing; objects are never made.

    Raises:
        InputError: it cannot be read, is damaged (every member carries a checksum), or is compressed.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as pack:
            if any(member.compress_type != ZIP_STORED for member in pack.zip.infolist()):
                raise InputError(f"{path} is compressed; expected arrays as they were written here")
            return {name: pack[name] for name in pack.files}
    except InputError:
        raise
    except Exception as error:  # NumPy parses headers by Python's own parser, which raises its own kinds
        raise InputError(f"{path} is damaged ({' '.join(str(error).split())[:100]})") from error


def _write(write: Callable[[bytes], object], piece: bytes, source: Path, target: Path) -> None:
    try:
        write(piece)
    except OSError as error:
        raise OutputError(
            f"no room to unpack {source} in {target.parent} ({error.strerror}); make room, or set TMPDIR"
        ) from error


def _size(count: int) -> str:
    return f"{count >> 20} MB" if count >= 2**20 else f"{count} bytes"
