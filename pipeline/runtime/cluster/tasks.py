"""Tasks for the workers of a cluster, and what comes of them.

What crosses the network are functions by name, their arguments, and small results; scans and clouds go by way of the
stage cache, a folder that all machines share.  Nothing is scattered: what was scattered to a worker that dies is lost,
while an argument is sent again with its task.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

from wiclosure.pipeline.runtime.cluster.failures import Absence, abandoned, asking, deadly, lost
from wiclosure.pipeline.runtime.cluster.task import done
from wiclosure.pipeline.runtime.processes import AHEAD
from wiclosure.workers import WorkCosts

if TYPE_CHECKING:
    from distributed import Client, Future

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

_OF_WORKERS = "all"  # the scheduler's own topic
_LISTEN_S = 0.5


class Cluster:
    """The workers of a scheduler, as `wiclosure.workers.Workers`.

    Args:
        client: connected to it.
        address: how the user named it.
    """

    remote = True

    def __init__(self, client: Client, address: str) -> None:
        self._client, self._address = client, address
        self.costs = WorkCosts()
        self._mailboxes: list[SimpleQueue[Any]] = []
        self._absence = Absence()
        client.subscribe_topic(_OF_WORKERS, self._of_workers)

    @property
    def count(self) -> int:
        """Threads of all workers that are there now.

        Raises:
            ProcessError: the scheduler is gone.
        """
        return max(1, self._threads())

    def _threads(self) -> int:
        self._require_scheduler()
        with asking(self._address):
            return int(sum(self._client.nthreads().values()))

    def leave(self) -> None:
        """Asks for no more news, before the client closes: the scheduler would complain of it that it is gone."""
        if self._client.status == "running":
            with suppress(OSError):
                self._client.unsubscribe_topic(_OF_WORKERS)

    def process_ids(self) -> dict[str, int]:
        """Of each worker, on its machine."""
        return dict(self._client.run(os.getpid))

    def each(
        self,
        work: Callable[[_Item], _Result],
        items: Iterable[_Item],
        *,
        named: Callable[[_Item], str] = str,
        told: Callable[..., None] | None = None,
    ) -> Generator[tuple[int, _Result], None, None]:
        """See `wiclosure.workers.Workers`; a task whose worker dies is done by another one."""
        running: dict[Future, tuple[int, _Item]] = {}
        left, workers = iter(enumerate(items)), self.count
        with self._mailbox() as (topic, mailbox), self._cancelled_in_the_end(running):
            while True:
                self._require_scheduler()
                while len(running) < AHEAD * workers and (following := next(left, None)) is not None:
                    running[self._submitted(work, *following, topic, mailbox)] = following
                if not running:
                    return
                message = self._next(mailbox)
                if isinstance(message, list | tuple):
                    self._heard(message, {future.key for future in running}, told)
                    workers = self.count if message[0] == "worker" else workers
                elif message is not None:
                    number, item = running.pop(message)
                    yield number, self._result(message, named(item))
                elif self._absence.too_long(self._threads()):
                    raise abandoned(self._address)

    @contextmanager
    def _mailbox(self) -> Iterator[tuple[str, SimpleQueue[Any]]]:
        """Takes futures that are done, news of one call, and of workers that come and go; and the topic of the news."""
        topic, mailbox = f"wiclosure-{uuid4().hex}", SimpleQueue[Any]()
        with asking(self._address):
            self._client.subscribe_topic(topic, lambda event: mailbox.put(event[1]))
        self._mailboxes.append(mailbox)
        try:
            yield topic, mailbox
        finally:
            self._mailboxes.remove(mailbox)
            if self._client.status == "running":
                self._client.unsubscribe_topic(topic)

    @contextmanager
    def _cancelled_in_the_end(self, running: Mapping[Future, Any]) -> Iterator[None]:
        """Tasks look now and then whether they were cancelled, see `task.done`."""
        try:
            yield
        finally:
            if running and self._client.status == "running":
                with suppress(OSError):
                    self._client.cancel(list(running), force=True)

    def _of_workers(self, event: tuple[float, Mapping[str, Any]]) -> None:
        if event[1].get("action") in {"add-worker", "remove-worker"}:
            for mailbox in list(self._mailboxes):
                mailbox.put(["worker", event[1]])

    def _submitted(
        self, work: Callable[[_Item], _Result], number: int, item: _Item, topic: str, mailbox: SimpleQueue[Any]
    ) -> Future:
        packed = pickle.dumps((work, item), protocol=5)
        self.costs.bytes_moved += len(packed)
        # Of tasks that are waiting the earlier ones come first.
        with asking(self._address):
            future = self._client.submit(done, packed, topic, pure=False, priority=-number)
        future.add_done_callback(mailbox.put)
        return future

    def _next(self, mailbox: SimpleQueue[Any]) -> Any:
        """A future that is done, news from a worker, or None after a while."""
        try:
            return mailbox.get(timeout=_LISTEN_S)
        except Empty:
            return None

    def _require_scheduler(self) -> None:
        """Fails where the client has noticed that the scheduler is gone."""
        if self._client.status != "running":
            raise lost(self._address)

    def _heard(self, message: Sequence[Any], running: set[str], told: Callable[..., None] | None) -> None:
        kind, *content = message
        if kind == "begun":
            self.costs.workers.update(content)
        elif kind == "worker" and content[0]["action"] == "remove-worker":
            self.costs.retries += len(running.intersection(content[0].get("processing-tasks", ())))
        elif kind == "news" and told is not None:
            told(*content)

    def _result(self, future: Future, name: str) -> Any:
        from distributed import KilledWorker
        from distributed.client import FutureCancelledError
        from distributed.scheduler import NoWorkerError

        if future.status in {"cancelled", "lost"}:
            raise lost(self._address)
        try:
            packed = future.result()
        except KilledWorker as error:
            raise deadly(name, error.allowed_failures + 1) from None
        except NoWorkerError:
            raise abandoned(self._address) from None
        except FutureCancelledError:  # the connection broke after the look at the status
            raise lost(self._address) from None
        finally:
            future.release()
        self.costs.bytes_moved += len(packed)
        return pickle.loads(packed)
