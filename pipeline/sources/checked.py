"""The one place that refuses scans which no odometry can use."""

from __future__ import annotations

import logging
from collections.abc import Iterator

from wiclosure.interfaces import ScanSource
from wiclosure.types import Scan

logger = logging.getLogger(__name__)


class CheckedSource:
    """A source without its empty scans and without stamps that repeat or go back; counts what it leaves out.

    Args:
        source: the source to check.
    """

    def __init__(self, source: ScanSource) -> None:
        self._source = source
        self._reset()

    def _reset(self) -> None:
        self._used = self._empty = self._back = self._repeated = 0
        self._ended = False

    @property
    def description(self) -> str:
        """One line for the user."""
        return self._source.description

    @property
    def diagnosis(self) -> tuple[str, ...]:
        """Sentences on what the last iteration left out; empty when it used everything."""
        sentences = []
        if self._empty:
            sentences.append(f"{self._empty} of {self._seen} scans had no valid points and were skipped.")
        if self._back:
            sentences.append(f"{self._back} of {self._seen} scans had stamps that go back in time and were skipped.")
        if self._repeated:
            sentences.append(f"{self._repeated} of {self._seen} scans repeated the stamp before and were skipped.")
        if self._ended and self._seen < len(self._source):
            sentences.append(f"Only {self._seen} of {len(self._source)} announced scans could be read.")
        if self._ended and not self._used:
            sentences.append("No scan could be used.")
        return tuple(f"{self.description}: {sentence}" for sentence in sentences)

    @property
    def _seen(self) -> int:
        return self._used + self._empty + self._back + self._repeated

    def __len__(self) -> int:
        """How many scans the recording announces, refused ones included."""
        return len(self._source)

    def __iter__(self) -> Iterator[Scan]:
        """The usable scans, stamps strictly increasing."""
        self._reset()
        latest_ns: int | None = None
        for scan in self._source:
            if len(scan.points) == 0:
                self._empty += 1
            elif latest_ns is not None and scan.stamp_ns == latest_ns:
                self._repeated += 1
            elif latest_ns is not None and scan.stamp_ns < latest_ns:
                self._back += 1
            else:
                self._used += 1
                latest_ns = scan.stamp_ns
                yield scan
        self._ended = True
        for sentence in self.diagnosis:
            logger.warning("%s", sentence)
