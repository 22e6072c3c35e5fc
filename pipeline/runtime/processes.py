"""Work in processes side by side that ends soon when nobody waits for it any more."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from itertools import chain, islice
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.queues import SimpleQueue
from multiprocessing.synchronize import Event
from threading import Thread
from typing import Any, TypeVar
from weakref import finalize

from wiclosure.blas import one_blas_thread_from_here
from wiclosure.errors import ProcessError
from wiclosure.pipeline.runtime.log import warnings_on_terminal
from wiclosure.workers import ThisProcess, Workers, at_work

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

AHEAD = 3  # items for each process that are there before it is done
_LISTEN_S = 0.2


class Processes:
    """Fresh processes on this machine: started when there is work, and kept until this object is gone.

    Args:
        count: how many at most.
    """

    costs = None
    remote = False

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool: _Pool | None = None

    def each(
        self,
        work: Callable[[_Item], _Result],
        items: Iterable[_Item],
        *,
        named: Callable[[_Item], str] = str,
        told: Callable[..., None] | None = None,
    ) -> Generator[tuple[int, _Result], None, None]:
        """See `wiclosure.workers.Workers`; ending early tells the processes to end, see `require_wanted`."""
        numbered = enumerate(items)
        if (first := next(numbered, None)) is None:
            return
        left, running = chain([first], numbered), dict[Future[_Result], int]()
        pool, self._pool = self._pool or _Pool(self.count), None
        with pool.ended_on_error():
            while True:
                for number, item in islice(left, AHEAD * self.count - len(running)):
                    running[pool.submitted(work, item)] = number
                if not running:
                    break
                done, _ = wait(running, timeout=_LISTEN_S, return_when=FIRST_COMPLETED)
                for heard in pool.news():
                    if told is not None:
                        told(*heard)
                for future in sorted(done, key=running.__getitem__):
                    yield running.pop(future), future.result()
        self._pool = pool


def local_workers(jobs: int) -> Workers:
    """So many processes; one is this one."""
    return ThisProcess() if jobs == 1 else Processes(jobs)


class _Pool:
    """Up to `count` fresh processes, what tells them to end, and the news that they send."""

    def __init__(self, count: int) -> None:
        # Forked processes would inherit locks that other libraries' threads hold.
        fresh = get_context("spawn")
        with interrupts_ignored():  # a queue is the first to need the process that tidies up after all others
            self._news: SimpleQueue[tuple[Any, ...]] = fresh.SimpleQueue()
            self._unwanted, self._others = fresh.Event(), set(active_children())
        begun_with = (self._unwanted, self._news)
        self._executor = ProcessPoolExecutor(count, mp_context=fresh, initializer=_begin, initargs=begun_with)
        # Waits for one that is still starting: the semaphores that it was given last as long as the executor.
        finalize(self, self._executor.shutdown)

    def submitted(self, work: Callable[[_Item], _Result], item: _Item) -> Future[_Result]:
        """Starts a process for it where all are at work and there may be more.

        Raises:
            BrokenProcessPool: one died, or could not be started.
        """
        try:
            with interrupts_ignored():
                return self._executor.submit(work, item)
        except (OSError, ValueError) as error:  # what comes of one that dies while the next is given its pipes
            raise BrokenProcessPool("a process could not be started") from error

    def news(self) -> Iterator[tuple[Any, ...]]:
        """What was told so far."""
        while not self._news.empty():
            yield self._news.get()

    @contextmanager
    def ended_on_error(self) -> Iterator[None]:
        """Leaving with an exception, an interruption too, tells the processes to end."""
        try:
            yield
        except BaseException as error:
            # Not terminated: one that dies while it sends a result leaves the pool waiting for the rest of it.
            self._unwanted.set()
            if isinstance(error, BrokenProcessPool):
                # The pool ends those that it knows of when one dies, and waits for one that just starts.
                for started in set(active_children()) - self._others:
                    started.terminate()
            with interrupts_ignored():  # impatience would leave workers behind
                self._executor.shutdown(cancel_futures=True)
            if isinstance(error, BrokenProcessPool):
                raise ProcessError(
                    "a process at work was killed; where memory is short, work with fewer at a time (-j)"
                ) from None
            raise


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
    one_blas_thread_from_here()
    Thread(target=_follow_parent, daemon=True).start()
    _FOR_LIFE.enter_context(warnings_on_terminal())
    _FOR_LIFE.enter_context(at_work(told=lambda *heard: news.put(heard), wanted=lambda: not unwanted.is_set()))


def _follow_parent() -> None:
    """Ends this worker when the process that began it is killed: between two works it would wait for ever."""
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)
