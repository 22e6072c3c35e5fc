"""Work in processes side by side that ends soon when nobody waits for it any more."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.synchronize import Event
from threading import Thread
from typing import TypeVar

from wiclosure.errors import ProcessError

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@contextmanager
def side_by_side(
    work: Callable[[_Item], _Result],
    items: Iterable[_Item],
    jobs: int,
    *,
    begin: Callable[..., None],
    given: tuple[object, ...],
) -> Iterator[list[Future[_Result]]]:
    """Every item is worked on in one of `jobs` fresh processes; entering gives what to wait for, in the items' order.

    Leaving with an exception, an interruption too, tells the processes to end, see `require_wanted`.

    Args:
        work: a function of a module, on one item.
        items: what is sent to the processes, one by one.
        jobs: how many processes.
        begin: called in each process before any work.
        given: its arguments.
    """
    # Forked processes would inherit locks that other libraries' threads hold.
    fresh = get_context("spawn")
    with interrupts_ignored():  # by the process, too, that tidies up after the others
        unwanted, others = fresh.Event(), set(active_children())
    pool = ProcessPoolExecutor(jobs, mp_context=fresh, initializer=_Worker.begin, initargs=(unwanted, begin, given))
    try:
        yield _submitted(pool, work, items)
    except BaseException as error:
        # Not terminated: one that dies while it sends a result leaves the pool waiting for the rest of it.
        unwanted.set()
        if isinstance(error, BrokenProcessPool):
            # The pool ends those that it knows of when one dies, and waits for one that just starts.
            for started in set(active_children()) - others:
                started.terminate()
            raise ProcessError(
                "a process at work was killed; where memory is short, work with fewer at a time (-j)"
            ) from None
        raise
    finally:
        with interrupts_ignored():  # impatience would leave workers behind
            pool.shutdown(cancel_futures=True)


def _submitted(
    pool: ProcessPoolExecutor, work: Callable[[_Item], _Result], items: Iterable[_Item]
) -> list[Future[_Result]]:
    """Starts the pool's processes.

    Raises:
        BrokenProcessPool: one died, or could not be started.
    """
    try:
        with interrupts_ignored():
            return [pool.submit(work, item) for item in items]
    except (OSError, ValueError) as error:  # what comes of one that dies while the next is given its pipes
        raise BrokenProcessPool("a process could not be started") from error


_FROM_TERMINAL = tuple(getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name))


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """For starting and ending processes.

    Ctrl-C, and the end of the terminal, reach them too, even while they import, and are none of their business: they
    inherit that they are to be ignored.
    """
    handlers = {number: signal.signal(number, signal.SIG_IGN) for number in _FROM_TERMINAL}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def require_wanted() -> None:
    """To be called now and then in long work: ends it when nobody waits for its result any more.

    Raises:
        InterruptedError: this is a worker, and the process that began it was interrupted.
    """
    if _Worker.unwanted is not None and _Worker.unwanted.is_set():
        raise InterruptedError("nobody waits for this work any more")


class _Worker:
    """What a worker knows of the process that began it."""

    unwanted: Event | None = None

    @classmethod
    def begin(cls, unwanted: Event, begin: Callable[..., None], given: tuple[object, ...]) -> None:
        cls.unwanted = unwanted
        Thread(target=cls._follow_parent, daemon=True).start()
        begin(*given)

    @staticmethod
    def _follow_parent() -> None:
        """Ends this worker when the process that began it is killed: between two works it would wait for ever."""
        if (parent := parent_process()) is not None:
            parent.join()
            os._exit(1)
