"""Work in processes side by side that ends soon when nobody waits for it any more."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Event
from threading import Thread
from typing import Any, TypeVar

from wiclosure.errors import ProcessError
from wiclosure.workers import ThisProcess, Workers, at_work

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_LISTEN_S = 0.2


class Processes:
    """Fresh processes on this machine, for each call anew.

    Args:
        count: how many.
    """

    costs = None
    remote = False

    def __init__(self, count: int) -> None:
        self.count = count

    def each(
        self,
        work: Callable[[_Item], _Result],
        items: Sequence[_Item],
        *,
        named: Callable[[_Item], str] = str,
        told: Callable[..., None] | None = None,
    ) -> Generator[tuple[int, _Result], None, None]:
        """See `wiclosure.workers.Workers`; ending early tells the processes to end, see `require_wanted`."""
        if not items:
            return
        with interrupts_ignored():  # a queue is the first to need the process that tidies up after all others
            news: SimpleQueue[tuple[Any, ...]] = get_context("spawn").SimpleQueue()
        with _side_by_side(work, items, min(self.count, len(items)), news) as futures:
            number, waiting = {future: n for n, future in enumerate(futures)}, set(futures)
            while waiting:
                done, waiting = wait(waiting, timeout=_LISTEN_S, return_when=FIRST_COMPLETED)
                while not news.empty():
                    heard = news.get()
                    if told is not None:
                        told(*heard)
                for future in sorted(done, key=number.__getitem__):
                    yield number[future], future.result()


def local_workers(jobs: int) -> Workers:
    """So many processes; one is this one."""
    return ThisProcess() if jobs == 1 else Processes(jobs)


@contextmanager
def _side_by_side(
    work: Callable[[_Item], _Result], items: Iterable[_Item], jobs: int, news: SimpleQueue[tuple[Any, ...]]
) -> Iterator[list[Future[_Result]]]:
    """Every item is worked on in one of `jobs` fresh processes; entering gives what to wait for, in the items' order.

    Leaving with an exception, an interruption too, tells the processes to end.
    """
    # Forked processes would inherit locks that other libraries' threads hold.
    fresh = get_context("spawn")
    with interrupts_ignored():
        unwanted, others = fresh.Event(), set(active_children())
    pool = ProcessPoolExecutor(jobs, mp_context=fresh, initializer=_begin, initargs=(unwanted, news))
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


_FOR_LIFE = ExitStack()


def _begin(unwanted: Event, news: SimpleQueue[tuple[Any, ...]]) -> None:
    """What a fresh process does before any work."""
    Thread(target=_follow_parent, daemon=True).start()
    _FOR_LIFE.enter_context(at_work(told=lambda *heard: news.put(heard), wanted=lambda: not unwanted.is_set()))


def _follow_parent() -> None:
    """Ends this worker when the process that began it is killed: between two works it would wait for ever."""
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)
