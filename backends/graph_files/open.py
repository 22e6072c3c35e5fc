"""The text or the bytes of a graph's file, packed or not."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from wiclosure.errors import InputError
from wiclosure.formats.text_table import utf16_of
from wiclosure.formats.unpacking import LARGEST_UNPACKED, ZSTD_MAGIC, Compression, UnpackError, largest_content, unpack

_STARTS: Mapping[bytes, Compression] = {b"\x1f\x8b": "gz", b"\xfd7zXZ": "xz", b"BZh": "bz2", ZSTD_MAGIC: "zstd"}
_SAMPLE = 4096  # bytes that tell the encoding
PACKED: Mapping[str, Compression] = {".gz": "gz", ".xz": "xz", ".bz2": "bz2", ".zst": "zstd"}


def read_bytes(path: Path) -> bytes:
    """What stands in the file, unpacked if gzip, xz, bzip2 or Zstandard packed it.

    Raises:
        InputError: the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the graph {path}: {error.strerror}; check the path") from error
    magic = next((packing for start, packing in _STARTS.items() if content.startswith(start)), None)
    compression = PACKED.get(path.suffix.lower()) or magic
    if compression is None:
        return content
    try:
        return unpack(content, compression, min(largest_content(len(content)), LARGEST_UNPACKED))
    except UnpackError as error:
        raise InputError(f"cannot unpack the graph {path}: {error}") from error


def read_text(path: Path) -> str:
    """The same as text, UTF-8 or UTF-16; bytes that are none become replacement characters, which no number holds.

    Raises:
        InputError: the file cannot be read, or holds no text.
    """
    content = read_bytes(path)
    encoding = utf16_of(content[:_SAMPLE])
    if encoding is None and b"\0" in content[:_SAMPLE]:
        kinds = ", ".join(PACKED)
        raise InputError(f"{path} holds no text; give the graph as text, packed at most as {kinds}")
    return content.decode(encoding or "utf-8-sig", errors="replace")


def begins_as_json(path: Path) -> bool:
    """Whether a JSON object stands in the file.

    Raises:
        InputError: the file cannot be read.
    """
    return read_bytes(path)[:_SAMPLE].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{")


def stem(path: Path) -> str:
    """The file's name without what tells its format: `sphere` of `sphere.g2o.xz`."""
    name = path.name
    for suffix in (*PACKED, ".cbor", ".g2o", ".jrl", ".json", ".graph", ".txt"):
        name = name.removesuffix(suffix) or name
    return name
