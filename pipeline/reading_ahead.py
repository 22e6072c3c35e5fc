"""Scans read by a process of its own while earlier ones are worked on.

KISS-ICP holds Python's interpreter lock, so a thread could not read beside it.
"""

from __future__ import annotations

import pickle
import socket
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context

import numpy as np

from wiclosure.errors import InputError
from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.processes import interrupts_ignored
from wiclosure.types import Scan

_LENGTH = struct.Struct("<Q")


@contextmanager
def read_ahead(source: ScanSource) -> Iterator[Iterator[Scan]]:
    """Entering starts the process, and gives the source's scans; leaving ends it.

    It is one scan ahead, and what the socket holds.  Whatever it raises is raised here.

    Raises:
        InputError: the process died.
    """
    here, there = socket.socketpair()
    with here:
        with there:
            # Ends by itself when this end of the socket is closed, even if this process is killed.
            reader = get_context("spawn").Process(target=_read, args=(source, there), daemon=True)
            with interrupts_ignored():
                reader.start()
        try:
            yield _arriving(here, source.description)
        finally:
            reader.terminate()
            reader.join()


def _arriving(here: socket.socket, description: str) -> Iterator[Scan]:
    while True:
        try:
            item = _receive(here)
        except EOFError:
            raise InputError(f"{description}: the process that read it died; is there enough memory?") from None
        if item is None:
            return
        if isinstance(item, Exception):
            raise item
        yield item


def _read(source: ScanSource, there: socket.socket) -> None:
    """What the process does: scans, then None, or an exception."""
    try:
        _send_all(source, there)
    except (BrokenPipeError, ConnectionResetError):
        return  # nobody waits for them any more


def _send_all(source: Iterable[Scan], there: socket.socket) -> None:
    try:
        for scan in source:
            _send(there, scan)
        _send(there, None)
    except (BrokenPipeError, ConnectionResetError):
        raise
    except Exception as error:
        _send(there, error)


def _send(there: socket.socket, item: Scan | Exception | None) -> None:
    """The lengths of all parts, the pickled item without its arrays, and these as they lie in memory."""
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(item, protocol=5, buffer_callback=buffers.append)
    arrays = [buffer.raw() for buffer in buffers]
    lengths = [len(pickled), *(array.nbytes for array in arrays)]
    there.sendall(_LENGTH.pack(len(lengths)) + b"".join(map(_LENGTH.pack, lengths)) + pickled)
    for array in arrays:
        there.sendall(array)


def _receive(here: socket.socket) -> Scan | Exception | None:
    (parts,) = _LENGTH.unpack(_take(here, _LENGTH.size))
    lengths = _LENGTH.iter_unpack(_take(here, parts * _LENGTH.size))
    pickled, *arrays = [_take(here, length) for (length,) in lengths]
    item: Scan | Exception | None = pickle.loads(pickled, buffers=arrays)
    return item


def _take(here: socket.socket, length: int) -> memoryview:
    """So many bytes.

    Raises:
        EOFError: the other end is closed.
    """
    taken = np.empty(length, np.uint8).data
    done = 0
    while done < length:
        count = here.recv_into(taken[done:], length - done, socket.MSG_WAITALL)
        if count == 0:
            raise EOFError
        done += count
    return taken
