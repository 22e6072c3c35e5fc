"""A bound on memory: work that would make the machine swap ends with a sentence instead."""

from __future__ import annotations

import os
import re
import signal
import time
from pathlib import Path
from threading import Thread

from wiclosure.display import significant
from wiclosure.errors import ConfigError

_EVERY_S = 0.1
_UNITS = {"": 1, "k": 2**10, "m": 2**20, "g": 2**30, "t": 2**40}
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kmgt]?)(?:i?b)?", re.IGNORECASE)


def bytes_of(text: str) -> int:
    """Bytes of `8GB`, `500M`, or `75%` of what the machine has.

    Raises:
        ConfigError: it is none of these, or nothing.
    """
    share = re.fullmatch(r"(\d+(?:\.\d+)?)%", text.strip())
    size = _SIZE.fullmatch(text.strip())
    limit = 0
    if share:
        limit = int(float(share[1]) / 100 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    elif size:
        limit = int(float(size[1]) * _UNITS[size[2].lower()])
    if limit <= 0:
        raise ConfigError(f"--memory {text}: expected a size, as 8GB or 500MB, or a share of the machine's, as 75%")
    return limit


class MemoryLimit:
    """Watches this process and those it began; interrupts the work, as Ctrl-C does, when together they take more.

    Args:
        limit_bytes: of memory that is theirs alone.
    """

    sentence: str | None = None
    """Why the work was interrupted, where it was."""

    def __init__(self, limit_bytes: int) -> None:
        self.limit_bytes = limit_bytes
        Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while (taken := memory_taken()) <= self.limit_bytes:
            time.sleep(_EVERY_S)
        MemoryLimit.sentence = (
            f"{significant(taken / 1e6)} MB of memory were taken, more than the limit of"
            f" {significant(self.limit_bytes / 1e6)} MB"
            " (--memory): work with fewer processes (-j), fewer scans (-n), larger keyframes.distance_m or"
            " map.voxel_size_m, or raise the limit"
        )
        os.kill(os.getpid(), signal.SIGINT)


def memory_taken() -> int:
    """Bytes that this process and all that it began take for themselves alone; 0 where the system does not tell."""
    waiting, taken = [os.getpid()], 0
    while waiting:
        pid = waiting.pop()
        try:
            resident, shared = Path(f"/proc/{pid}/statm").read_text().split()[1:3]
            waiting += [
                int(child)
                for children in Path(f"/proc/{pid}/task").glob("*/children")
                for child in children.read_text().split()
            ]
        except OSError:  # it has ended meanwhile
            continue
        taken += (int(resident) - int(shared)) * os.sysconf("SC_PAGE_SIZE")
    return taken
