"""The three pools of workers do the same; what the cluster does besides when workers, tasks or schedulers die."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from types import ModuleType
from unittest.mock import Mock

import pytest

from wiclosure.errors import ConfigError, InputError, ProcessError
from wiclosure.pipeline.runtime.cluster.connection import TlsFiles, cluster
from wiclosure.pipeline.runtime.cluster.tasks import Cluster
from wiclosure.pipeline.runtime.processes import Processes
from wiclosure.workers import ThisProcess, Workers

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


@pytest.fixture(scope="module")
def dask(labour: ModuleType) -> Iterator[Cluster]:
    pytest.importorskip("distributed")
    with cluster("local:2") as found:
        yield found


@pytest.fixture(params=["here", "processes", "dask"])
def workers(request: pytest.FixtureRequest, dask: Cluster) -> Workers:
    pools: dict[str, Workers] = {"here": ThisProcess(), "processes": Processes(2), "dask": dask}
    return pools[request.param]


def test_results_are_the_same_to_the_last_bit(workers: Workers, labour: ModuleType) -> None:
    heard: list[tuple[object, ...]] = []
    found = dict(workers.each(labour.solve, range(7), told=lambda *news: heard.append(tuple(news))))
    assert sorted(found) == list(range(7))
    for seed, x in found.items():
        assert x.tobytes() == labour.solve(seed).tobytes()
    assert sorted(heard) == [("seed", seed) for seed in range(7)]


def test_what_an_item_lacks_is_raised_as_it_is(workers: Workers, labour: ModuleType) -> None:
    with (
        pytest.raises(InputError, match="the third is damaged"),
        closing(workers.each(labour.refuse, range(5))) as done,
    ):
        dict(done)


def test_workers_keep_memory_for_their_next_arrays(dask: Cluster) -> None:
    setting = "MALLOC_TRIM_THRESHOLD_"
    assert [value for _, value in dask.each(os.getenv, [setting])] == [os.getenv(setting)]


def test_nobody_looks_at_what_workers_do_a_hundred_times_a_second(dask: Cluster) -> None:
    dask_config = pytest.importorskip("dask.config")
    assert [value for _, value in dask.each(dask_config.get, ["distributed.worker.profile.enabled"])] == [False]


@pytest.mark.usefixtures("dask")
def test_a_second_one_runs_beside_the_first(labour: ModuleType) -> None:
    with cluster("local:1") as second:  # warnings are errors: each has ports of its own
        assert dict(second.each(labour.solve, [3])).keys() == {0}


def test_nothing_to_do_is_done(workers: Workers, labour: ModuleType) -> None:
    assert list(workers.each(labour.solve, [])) == []


def test_what_runs_is_ended_when_nobody_waits(dask: Cluster, labour: ModuleType, tmp_path: Path) -> None:
    done = dask.each(labour.go_on, [tmp_path])
    waiting = threading.Thread(target=lambda: _until(tmp_path / "begun"))
    waiting.start()
    with pytest.raises(RuntimeError, match="enough"), closing(done):
        _first_or(done, waiting)
    _until(tmp_path / "ended")


def _first_or(done: Iterator[object], waiting: threading.Thread) -> None:
    """Runs into the work, and is interrupted once it has begun."""

    def interrupt() -> None:
        waiting.join()
        signal.raise_signal(signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    try:
        next(done)
    except KeyboardInterrupt:
        raise RuntimeError("enough") from None


def _until(path: Path, seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not path.exists():
        assert time.monotonic() < end, f"{path.name} did not happen"
        time.sleep(0.02)


@pytest.mark.slow
def test_a_killed_worker_costs_its_work_only(dask: Cluster, labour: ModuleType, tmp_path: Path) -> None:
    before = dask.costs.retries
    assert dict(dask.each(labour.die_once, [tmp_path])) == {0: "done"}
    assert dask.costs.retries == before + 1


@pytest.mark.slow
def test_a_task_that_kills_every_worker_is_named(dask: Cluster, labour: ModuleType) -> None:
    with pytest.raises(ProcessError, match=r"^item 5 killed 4 workers, one after the other"):
        dict(dask.each(labour.die, [5], named=lambda item: f"item {item}"))


@pytest.mark.slow
@pytest.mark.parametrize("while_waiting", [True, False], ids=["while waiting", "between results"])
def test_a_lost_scheduler_is_one_line(while_waiting: bool, labour: ModuleType, tmp_path: Path) -> None:
    with scheduler_and_worker(tmp_path) as (scheduler, address, _):
        lost = pytest.raises(ProcessError, match=r"the scheduler at .* is gone; finished stages are kept")
        with lost, cluster(address) as c:
            if while_waiting:
                threading.Thread(target=lambda: (_until(tmp_path / "begun"), scheduler.kill()), daemon=True).start()
                dict(c.each(labour.go_on, [tmp_path]))
            for number, _ in c.each(labour.solve, range(50)):
                if number == 10:
                    scheduler.kill()
                    scheduler.wait()


@pytest.mark.slow
@pytest.mark.parametrize("whose", ["client", "scheduler"])
def test_workers_that_stay_away_are_one_line(
    whose: str, labour: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dask's time for that counts, of whoever has it."""
    import dask

    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__NO_WORKERS_TIMEOUT", "2s" if whose == "scheduler" else "1h")
    with (
        dask.config.set({"distributed.scheduler.no-workers-timeout": "2s" if whose == "client" else "1h"}),
        scheduler_and_worker(tmp_path) as (_, address, worker),
        cluster(address) as connected,
    ):
        (pid,) = connected.process_ids().values()

        def kill() -> None:
            _until(tmp_path / "begun")
            worker.kill()  # it would start another one
            os.kill(pid, signal.SIGKILL)

        threading.Thread(target=kill, daemon=True).start()
        told = rf"all workers of {address} are gone, and none has come back; .*: start some \(dask worker {address}\)"
        with pytest.raises(ProcessError, match=told):
            dict(connected.each(labour.go_on, [tmp_path]))


@contextmanager
def scheduler_and_worker(
    folder: Path, *options: str, protocol: str = "tcp"
) -> Iterator[tuple[subprocess.Popen[bytes], str, subprocess.Popen[bytes]]]:
    """As users start them, at a port that is free; the scheduler, its address, and the worker."""
    pytest.importorskip("distributed")
    told = folder / "scheduler.json"
    started = []

    def start(command: str, *arguments: str) -> subprocess.Popen[bytes]:
        words = [sys.executable, "-m", f"distributed.cli.dask_{command}", "--scheduler-file", str(told), *options]
        started.append(subprocess.Popen([*words, *arguments, "--no-dashboard"], stderr=subprocess.DEVNULL))
        return started[-1]

    try:
        scheduler = start("scheduler", "--host", "127.0.0.1", "--port", "0", "--protocol", protocol)
        _until(told, 60.0)
        worker = start("worker", "--nthreads", "1", "--host", "127.0.0.1", "--protocol", protocol)
        yield scheduler, _address(told), worker
    finally:
        for process in started:
            process.kill()
            process.wait()


def _address(told: Path) -> str:
    """The scheduler's, once all of its file is there."""
    while True:
        try:
            return str(json.loads(told.read_text())["address"])
        except json.JSONDecodeError:
            time.sleep(0.02)


@pytest.mark.parametrize("address", ["local:0", "local:two"])
def test_a_number_of_workers_is_a_number(address: str, labour: ModuleType) -> None:
    with pytest.raises(ConfigError, match="expected local:N"), cluster(address):
        pass


def test_nobody_there_is_one_line(labour: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wiclosure.pipeline.runtime.cluster.connection._ANSWER_S", 1.0)
    with (
        pytest.raises(ConfigError, match=r"no scheduler answers at tcp://127\.0\.0\.1:1"),
        cluster("tcp://127.0.0.1:1"),
    ):
        pass


@pytest.mark.parametrize("going", ["wait_for_workers", "run", "subscribe_topic"])
def test_a_scheduler_that_goes_while_one_connects_is_lost(monkeypatch: pytest.MonkeyPatch, going: str) -> None:
    pytest.importorskip("distributed")
    gone = Mock(
        status="running", **{f"{going}.side_effect": ConnectionResetError(104, "reset"), "run.return_value": {}}
    )
    monkeypatch.setattr("wiclosure.pipeline.runtime.cluster.connection._connected", lambda *_: gone)
    with pytest.raises(ProcessError, match=r"the scheduler at tcp://here:1 is gone"), cluster("tcp://here:1"):
        pass
    gone.close.assert_called_once()


def test_a_client_that_closes_between_two_tasks_has_lost_its_scheduler() -> None:
    closed = pytest.importorskip("distributed.client").ClosedClientError
    client = Mock(status="running", **{"submit.side_effect": closed("closed"), "nthreads.return_value": {"a": 1}})
    with pytest.raises(ProcessError, match=r"the scheduler at tcp://here:1 is gone"):
        list(Cluster(client, "tcp://here:1").each(str, range(3)))


def test_tls_files_are_three_and_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected three files"):
        TlsFiles.of_words("ca.pem")
    with pytest.raises(ConfigError, match=r"ca\.pem is not a file"):
        TlsFiles.of_words(",".join(str(tmp_path / name) for name in ("ca.pem", "cert.pem", "key.pem")))


@pytest.mark.slow
def test_tls_needs_the_files_that_the_scheduler_trusts(labour: ModuleType, tmp_path: Path) -> None:
    ours, theirs = tls_files(tmp_path / "ours"), tls_files(tmp_path / "theirs")
    options = ["--tls-ca-file", str(ours.ca), "--tls-cert", str(ours.certificate), "--tls-key", str(ours.key)]
    with scheduler_and_worker(tmp_path, *options, protocol="tls") as (_, address, _):
        assert address.startswith("tls://127.0.0.1:")
        words = ",".join(str(path) for path in (ours.ca, ours.certificate, ours.key))
        with cluster(address, TlsFiles.of_words(words)) as connected:
            found = dict(connected.each(labour.solve, range(3)))
        assert [found[seed].tobytes() for seed in range(3)] == [labour.solve(seed).tobytes() for seed in range(3)]
        for strangers in (theirs, None):
            with (
                pytest.raises(ConfigError, match=r"no scheduler answers at tls://.*; see --cluster and --cluster-tls"),
                cluster(address, strangers),
            ):
                pass


def tls_files(folder: Path) -> TlsFiles:
    """An authority that signs itself, and a certificate for this machine that it signs."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    folder.mkdir()
    of_authority, own = (ec.generate_private_key(ec.SECP256R1()) for _ in range(2))
    authority = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "authority")])
    machine = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "127.0.0.1")])
    now = datetime.now(UTC)
    for name, subject, key, is_authority in (
        ("ca.pem", authority, of_authority, True),
        ("cert.pem", machine, own, False),
    ):
        signed = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(authority)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - timedelta(hours=1))
            .not_valid_after(now + timedelta(hours=1))
            .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), critical=False)
            .add_extension(x509.BasicConstraints(ca=is_authority, path_length=None), critical=True)
            .sign(of_authority, hashes.SHA256())
        )
        (folder / name).write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    (folder / "key.pem").write_bytes(
        own.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return TlsFiles(folder / "ca.pem", folder / "cert.pem", folder / "key.pem")


def test_without_dask_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match=r"pip install 'wiclosure\[cluster\]'"), cluster("local:2"):
        pass
