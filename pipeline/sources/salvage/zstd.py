"""Zstandard, by which ROS 2 compresses messages, chunks and whole files; rosbags brings the library."""

from __future__ import annotations

import logging
import shutil
import sys
from pathlib import Path

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

logger = logging.getLogger(__name__)

ZstdError = zstd.ZstdError
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def decompress(data: bytes) -> bytes:
    """The content of a whole frame."""
    return zstd.decompress(data)


def decompress_partly(data: bytes) -> bytes:
    """The content of a frame that may be cut, as far as it goes."""
    try:
        return zstd.ZstdDecompressor().decompress(data)
    except zstd.ZstdError as error:
        raise ValueError(str(error)) from error


def decompress_file(source: Path, target: Path) -> None:
    """Unpacks a file; of a cut one, what is there."""
    with zstd.open(source, "rb") as packed, target.open("wb") as file:
        try:
            shutil.copyfileobj(packed, file)
        except (EOFError, zstd.ZstdError) as error:
            logger.info("%s: %s", source, error)
