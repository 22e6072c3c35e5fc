"""Work in processes side by side that ends at once when the one who waits for it is interrupted."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


@contextmanager
def side_by_side(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    jobs: int,
    *,
    begin: Callable[..., None],
    given: tuple[object, ...],
) -> Iterator[list[Future[Result]]]:
    """Every item is worked on in one of `jobs` fresh processes; entering gives what to wait for, in the items' order.

    Args:
        work: a function of a module, on one item.
        items: what is sent to the processes, one by one.
        jobs: how many processes.
        begin: called in each process before any work.
        given: its arguments.
    """
    # Ctrl-C reaches workers too, even while they still import: they inherit that it is none of their business.
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Forked processes would inherit locks that other libraries' threads hold.
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=begin, initargs=given)
    try:
        futures = [pool.submit(work, item) for item in items]
        signal.signal(signal.SIGINT, handler)
        yield futures
    except BaseException:
        for worker in active_children():
            worker.terminate()
        raise
    finally:
        signal.signal(signal.SIGINT, handler)
        pool.shutdown(cancel_futures=True)
