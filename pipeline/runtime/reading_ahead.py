"""Scans read by a process of its own while earlier ones are worked on.

KISS-ICP holds Python's interpreter lock, so a thread could not read beside it.
"""

from __future__ import annotations

import pickle
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from typing import Any

import numpy as np

from wiclosure.errors import InputError
from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.runtime.processes import interrupts_ignored
from wiclosure.types import Scan

_LENGTH = struct.Struct("<Q")
_GONE = (EOFError, BrokenPipeError, ConnectionResetError)  # the process at the other end is


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
            reader = get_context("spawn").Process(target=_read, args=(there,), daemon=True)
            with interrupts_ignored():
                reader.start()
        try:
            yield _arriving(here, source)
        finally:
            reader.terminate()
            reader.join()


def _arriving(here: socket.socket, source: ScanSource) -> Iterator[Scan]:
    # Not as an argument of the process: to one that dies while it starts, Python would write for ever.
    with _alive(source):
        _send(here, source)
    while True:
        with _alive(source):
            item = _receive(here)
        if item is None:
            return
        if isinstance(item, Exception):
            raise item
        yield item


@contextmanager
def _alive(source: ScanSource) -> Iterator[None]:
    try:
        yield
    except _GONE:
        raise InputError(f"{source.description}: the process that read it died; is there enough memory?") from None


def _read(there: socket.socket) -> None:
    """What the process does: takes a source, and sends its scans, then None; or what the source raised."""
    with suppress(*_GONE):  # then nobody waits for them any more
        source = _receive(there)
        scans = iter(source)
        while True:
            try:
                item = next(scans, None)
            except Exception as error:  # what it is, is for the other end to tell
                item = _sendable(error)
            _send(there, item)
            if not isinstance(item, Scan):
                return


def _sendable(error: Exception) -> Exception:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:  # whatever it carries along
        return InputError(f"{type(error).__name__}: {error}")
    return error


def _send(there: socket.socket, item: object) -> None:
    """The lengths of all parts, the pickled item without its arrays, and these as they lie in memory."""
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(item, protocol=5, buffer_callback=buffers.append)
    arrays = [buffer.raw() for buffer in buffers]
    lengths = [len(pickled), *(array.nbytes for array in arrays)]
    there.sendall(_LENGTH.pack(len(lengths)) + b"".join(map(_LENGTH.pack, lengths)) + pickled)
    for array in arrays:
        there.sendall(array)


def _receive(here: socket.socket) -> Any:
    (parts,) = _LENGTH.unpack(_take(here, _LENGTH.size))
    lengths = _LENGTH.iter_unpack(_take(here, parts * _LENGTH.size))
    pickled, *arrays = [_take(here, length) for (length,) in lengths]
    return pickle.loads(pickled, buffers=arrays)


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
