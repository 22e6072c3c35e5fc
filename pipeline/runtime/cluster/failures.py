"""What ends a run on a cluster: one line each, and what to do."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from wiclosure.errors import ProcessError

LOCAL = "local:"
_AWAY_S = 120.0  # all workers may be away so long: those that died start again within seconds


class Absence:
    """How long all workers have been away; dask's `no-workers-timeout` counts where it is set."""

    def __init__(self) -> None:
        self._since_s: float | None = None

    def too_long(self, workers: int) -> bool:
        """Whether none has come back in time.

        Args:
            workers: how many are there now.
        """
        if workers > 0:
            self._since_s = None
            return False
        import dask
        from dask.utils import parse_timedelta

        patience_s = parse_timedelta(dask.config.get("distributed.scheduler.no-workers-timeout", None)) or _AWAY_S
        now = time.monotonic()
        self._since_s = now if self._since_s is None else self._since_s
        return now - self._since_s > patience_s


def abandoned(address: str) -> ProcessError:
    """No worker is left."""
    again = "run the same again"
    if not address.startswith(LOCAL):
        again = f"start some (dask worker {address}), and {again}"
    return ProcessError(f"all workers of {address} are gone, and none has come back; finished stages are kept: {again}")


def lost(address: str) -> ProcessError:
    """The scheduler is gone."""
    return ProcessError(
        f"the scheduler at {address} is gone; finished stages are kept: start it, and run the same again"
    )


@contextmanager
def asking(address: str) -> Iterator[None]:
    """Around what a client asks the scheduler: it may be gone before the client has noticed.

    Raises:
        ProcessError: it is.
    """
    from distributed.client import ClosedClientError

    try:
        yield
    except (OSError, ClosedClientError):
        raise lost(address) from None


def deadly(work: str, workers: int) -> ProcessError:
    """Some work killed one worker after the other."""
    return ProcessError(
        f"{work} killed {workers} workers, one after the other; is there enough memory for it?"
        " (dask worker --memory-limit)"
    )
