"""What a worker of a cluster does: one piece of work, and news of it."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable

from wiclosure.workers import at_work

_NEWS_S = 1.0  # every worker's news pass the scheduler


def done(packed: bytes, topic: str) -> bytes:
    """The pickled result of a pickled function and its argument; news go to the topic."""
    from distributed import get_worker

    worker = get_worker()
    key = worker.get_current_task()
    worker.log_event(topic, ["begun", worker.address])

    def wanted() -> bool:
        known = worker.state.tasks.get(key)
        return known is not None and known.state != "cancelled"

    work, item = pickle.loads(packed)
    news = _News(lambda *content: worker.log_event(topic, ["news", *content]))
    with at_work(told=news.tell, wanted=wanted):
        result = work(item)
    news.tell_last()
    return pickle.dumps(result, protocol=5)


class _News:
    """Tells some of the news, and the last in any case."""

    def __init__(self, told: Callable[..., None]) -> None:
        self._told, self._last_s = told, time.monotonic()
        self._waiting: tuple[object, ...] | None = None

    def tell(self, *content: object) -> None:
        self._waiting = content
        if time.monotonic() - self._last_s > _NEWS_S:
            self.tell_last()

    def tell_last(self) -> None:
        if self._waiting is not None:
            self._told(*self._waiting)
            self._waiting, self._last_s = None, time.monotonic()
