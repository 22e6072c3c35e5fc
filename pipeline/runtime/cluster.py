"""Work on the workers of a dask cluster: `dask worker` processes in which this package is installed.

What crosses the network are functions by name, their arguments, and small results; scans and clouds go by way of the
stage cache, a folder that all machines share.  Nothing is scattered: what was scattered to a worker that dies is lost,
while an argument is sent again with its task.
"""

from __future__ import annotations

import logging
import os
import pickle
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar
from uuid import uuid4

from wiclosure.errors import ConfigError, ProcessError
from wiclosure.pipeline.runtime.processes import interrupts_ignored
from wiclosure.pipeline.runtime.worker_versions import VersionsOf, versions
from wiclosure.workers import WorkCosts, at_work

if TYPE_CHECKING:
    from distributed import Client, Future

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

LOCAL = "local:"
_OF_WORKERS = "all"  # the scheduler's own topic
_START_S = 60.0
_ANSWER_S = 10.0
_LISTEN_S = 0.5
_NEWS_S = 1.0  # every worker's news pass the scheduler
_AWAY_S = 120.0  # all workers may be away so long: those that died start again within seconds


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """PEM files for a scheduler that speaks TLS: of the authority, of this client, and its key."""

    ca: Path
    certificate: Path
    key: Path

    @classmethod
    def of_words(cls, words: str) -> TlsFiles:
        """From `ca.pem,cert.pem,key.pem`.

        Raises:
            ConfigError: not three, or one is missing.
        """
        paths = [Path(word) for word in words.split(",")]
        if len(paths) != 3:
            raise ConfigError(f"--cluster-tls {words}: expected three files, ca.pem,cert.pem,key.pem")
        for path in paths:
            if not path.is_file():
                raise ConfigError(f"--cluster-tls: {path} is not a file")
        return cls(*paths)


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
        self._away_since_s: float | None = None
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
        try:
            return int(sum(self._client.nthreads().values()))
        except OSError:  # it went before the client noticed
            raise self._lost() from None

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
        items: Sequence[_Item],
        *,
        named: Callable[[_Item], str] = str,
        told: Callable[..., None] | None = None,
    ) -> Generator[tuple[int, _Result], None, None]:
        """See `wiclosure.workers.Workers`; a task whose worker dies is done by another one."""
        running: dict[Future, int] = {}
        left, workers = iter(enumerate(items)), self.count
        with self._mailbox() as (topic, mailbox), self._cancelled_in_the_end(running):
            while True:
                self._require_scheduler()
                while len(running) < 3 * workers and (following := next(left, None)) is not None:
                    running[self._submitted(work, *following, topic, mailbox)] = following[0]
                if not running:
                    return
                message = self._next(mailbox)
                if isinstance(message, list | tuple):
                    self._heard(message, {future.key for future in running}, told)
                    workers = self.count if message[0] == "worker" else workers
                elif message is not None:
                    number = running.pop(message)
                    yield number, self._result(message, named(items[number]))
                else:
                    self._require_workers()

    @contextmanager
    def _mailbox(self) -> Iterator[tuple[str, SimpleQueue[Any]]]:
        """Takes futures that are done, news of one call, and of workers that come and go; and the topic of the news."""
        topic, mailbox = f"wiclosure-{uuid4().hex}", SimpleQueue[Any]()
        self._client.subscribe_topic(topic, lambda event: mailbox.put(event[1]))
        self._mailboxes.append(mailbox)
        try:
            yield topic, mailbox
        finally:
            self._mailboxes.remove(mailbox)
            if self._client.status == "running":
                self._client.unsubscribe_topic(topic)

    @contextmanager
    def _cancelled_in_the_end(self, running: dict[Future, int]) -> Iterator[None]:
        """Tasks look now and then whether they were cancelled, see `_task`."""
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
        future = self._client.submit(_task, packed, topic, pure=False, priority=-number)
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
            raise self._lost()

    def _require_workers(self) -> None:
        """Fails where all workers have been away for long; dask's `no-workers-timeout` counts where it is set."""
        if self._threads() > 0:
            self._away_since_s = None
            return
        import dask
        from dask.utils import parse_timedelta

        patience_s = parse_timedelta(dask.config.get("distributed.scheduler.no-workers-timeout", None)) or _AWAY_S
        now = time.monotonic()
        self._away_since_s = now if self._away_since_s is None else self._away_since_s
        if now - self._away_since_s > patience_s:
            raise self._abandoned()

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
        from distributed.scheduler import NoWorkerError

        if future.status in {"cancelled", "lost"}:
            raise self._lost()
        try:
            packed = future.result()
        except KilledWorker as error:
            raise ProcessError(
                f"{name} killed {error.allowed_failures + 1} workers, one after the other; is there"
                " enough memory for it? (dask worker --memory-limit)"
            ) from None
        except NoWorkerError:
            raise self._abandoned() from None
        finally:
            future.release()
        self.costs.bytes_moved += len(packed)
        return pickle.loads(packed)

    def _abandoned(self) -> ProcessError:
        again = "run the same again"
        if not self._address.startswith(LOCAL):
            again = f"start some (dask worker {self._address}), and {again}"
        return ProcessError(
            f"all workers of {self._address} are gone, and none has come back; finished stages are kept: {again}"
        )

    def _lost(self) -> ProcessError:
        return ProcessError(
            f"the scheduler at {self._address} is gone; finished stages are kept: start it, and run the same again"
        )


def _task(packed: bytes, topic: str) -> bytes:
    """What a worker does."""
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


@contextmanager
def cluster(address: str, tls: TlsFiles | None = None) -> Iterator[Cluster]:
    """Connects to a scheduler, or starts workers here, and checks that they run the same code.

    Args:
        address: `tcp://HOST:PORT`, `tls://HOST:PORT`, or `local:N`.
        tls: files for TLS.

    Raises:
        ConfigError: dask is not installed, nobody answers, there are no workers, or their code or libraries differ.
    """
    try:
        import distributed
    except ImportError:
        raise ConfigError("--cluster needs dask.distributed: pip install 'wiclosure[cluster]'") from None
    with ExitStack() as open_until_then:
        if address.startswith(LOCAL):
            client = open_until_then.enter_context(_local(address))
        else:
            client = _connected(address, tls)
            open_until_then.callback(client.close)
        try:
            client.wait_for_workers(1, timeout=_START_S)
        except (TimeoutError, distributed.TimeoutError):
            raise ConfigError(f"the scheduler at {address} has no workers; start some: dask worker {address}") from None
        _require_alike(client.run(versions, on_error="return"))
        workers = Cluster(client, address)
        open_until_then.callback(workers.leave)
        yield workers


@contextmanager
def _local(address: str) -> Iterator[Client]:
    from distributed import Client, LocalCluster

    count = address.removeprefix(LOCAL)
    if not count.isdigit() or int(count) == 0:
        raise ConfigError(f"--cluster {address}: expected local:N with the number of workers, for example local:4")
    with interrupts_ignored():
        started = LocalCluster(
            n_workers=int(count), threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
        )
        client = Client(started)
    try:
        yield client
    finally:
        with interrupts_ignored():
            client.close()
            started.close()


def _connected(address: str, tls: TlsFiles | None) -> Client:
    from distributed import Client, Security

    security = None
    if tls is not None:
        security = Security(
            tls_ca_file=str(tls.ca),
            tls_client_cert=str(tls.certificate),
            tls_client_key=str(tls.key),
            require_encryption=True,
        )
    try:
        return Client(address, security=security, timeout=_ANSWER_S)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).strip().splitlines()[0]
        raise ConfigError(f"no scheduler answers at {address} ({reason}); see --cluster and --cluster-tls") from None


def _require_alike(found: Mapping[str, VersionsOf | Exception]) -> None:
    """Fails where a worker has other code or libraries: its results could differ, or fail after hours."""
    here = versions()
    for worker, there in found.items():
        if isinstance(there, Exception):
            raise ConfigError(f"worker {worker} has no working wiclosure ({there}); install the same version there")
        if different := [name for name in here if there.get(name) != here[name]]:
            name = different[0]
            raise ConfigError(
                f"worker {worker} has {name} {there.get(name) or 'missing'}, this machine has {here[name] or 'none'};"
                " install the same on both"
            )
