"""A scheduler that is there already, or workers that are started here: both run the same code, or nothing begins."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from wiclosure.errors import ConfigError
from wiclosure.pipeline.runtime.cluster.failures import LOCAL, asking
from wiclosure.pipeline.runtime.cluster.tasks import Cluster
from wiclosure.pipeline.runtime.cluster.versions import VersionsOf, versions
from wiclosure.pipeline.runtime.processes import interrupts_ignored

if TYPE_CHECKING:
    from distributed import Client

_START_S = 60.0
_ANSWER_S = 10.0
_LEAN = {
    # With dask's own setting malloc asks the system anew for each larger array: a quarter of odometry's time.
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": None,
    # A hundred looks a second at the stack of the task, and fifty at the event loop, for a dashboard that is not there.
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
}


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


@contextmanager
def cluster(address: str, tls: TlsFiles | None = None) -> Iterator[Cluster]:
    """Connects to a scheduler, or starts workers here, and checks that they run the same code.

    Args:
        address: `tcp://HOST:PORT`, `tls://HOST:PORT`, or `local:N`.
        tls: files for TLS.

    Raises:
        ConfigError: dask is not installed, nobody answers, there are no workers, or their code or libraries differ.
        ProcessError: the scheduler went meanwhile.
    """
    try:
        import distributed
    except ImportError:
        raise ConfigError("--cluster needs dask.distributed: pip install 'wiclosure[cluster]'") from None
    from distributed.utils import silence_logging_cmgr

    with ExitStack() as open_until_then:
        # What goes wrong is told here, in one line: dask's own account of it would be pages of traceback.
        open_until_then.enter_context(silence_logging_cmgr(logging.CRITICAL))
        if address.startswith(LOCAL):
            client = open_until_then.enter_context(_local(address))
        else:
            client = _connected(address, tls)
            open_until_then.callback(client.close)
        with asking(address):
            try:
                client.wait_for_workers(1, timeout=_START_S)
            except (TimeoutError, distributed.TimeoutError):
                raise ConfigError(
                    f"the scheduler at {address} has no workers; start some: dask worker {address}"
                ) from None
            _require_alike(client.run(versions, on_error="return"))
            workers = Cluster(client, address)
        open_until_then.callback(workers.leave)
        yield workers


@contextmanager
def _local(address: str) -> Iterator[Client]:
    import dask
    from distributed import Client, LocalCluster

    count = address.removeprefix(LOCAL)
    if not count.isdigit() or int(count) == 0:
        raise ConfigError(f"--cluster {address}: expected local:N with the number of workers, for example local:4")
    with interrupts_ignored(), dask.config.set(_LEAN):
        started = LocalCluster(
            n_workers=int(count),
            threads_per_worker=1,
            # A free port of this machine alone: without an address it would be the same one for all who run here.
            dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL,
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
        if tls is None and "ssl_context" in reason:
            reason = "tls:// needs the files of --cluster-tls CA,CERT,KEY"
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
