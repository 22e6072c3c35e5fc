"""The three pools of workers do the same; what the cluster does besides when workers, tasks or schedulers die."""

from __future__ import annotations

import importlib
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import ModuleType

import pytest

from wiclosure.errors import ConfigError, InputError, ProcessError
from wiclosure.pipeline.runtime.cluster import Cluster, TlsFiles, cluster
from wiclosure.pipeline.runtime.processes import Processes
from wiclosure.workers import ThisProcess, Workers

# A module of its own: workers import what they work with by name.
LABOUR = """
import os, signal, time
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.workers import require_wanted, tell

def solve(seed):
    tell("seed", seed)
    A = np.random.default_rng(seed).normal(size=(30, 30))
    return np.linalg.solve(A @ A.T + np.eye(30), np.ones(30))

def refuse(item):
    if item == 3:
        raise InputError("the third is damaged")
    return item

def die(item):
    os.kill(os.getpid(), signal.SIGKILL)

def die_once(folder):
    if not Path(folder, "died").exists():
        Path(folder, "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"

def go_on(folder):
    Path(folder, "begun").touch()
    while True:
        try:
            require_wanted()
        except InterruptedError:
            Path(folder, "ended").touch()
            raise
        time.sleep(0.01)
"""

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")


@pytest.fixture(scope="module")
def labour(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    pytest.importorskip("distributed")
    folder = tmp_path_factory.mktemp("labour_of_clusters")
    (folder / "labour_of_clusters.py").write_text(LABOUR)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.setenv("PYTHONPATH", str(folder), prepend=":")
        yield importlib.import_module("labour_of_clusters")


@pytest.fixture(scope="module")
def dask(labour: ModuleType) -> Iterator[Cluster]:
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
        import signal

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
def test_a_lost_scheduler_is_one_line(labour: ModuleType, tmp_path: Path) -> None:
    import subprocess

    scheduler = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "distributed.cli.dask_scheduler",
            "--port",
            "18786",
            "--host",
            "127.0.0.1",
            "--no-dashboard",
        ],
        stderr=subprocess.DEVNULL,
    )
    address = "tcp://127.0.0.1:18786"
    worker = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"],
        stderr=subprocess.DEVNULL,
    )
    try:
        with (
            pytest.raises(ProcessError, match=r"the scheduler at .* is gone; finished stages are kept"),
            cluster(address) as c,
        ):
            threading.Thread(target=lambda: (_until(tmp_path / "begun"), scheduler.kill()), daemon=True).start()
            dict(c.each(labour.go_on, [tmp_path]))
    finally:
        for process in (scheduler, worker):
            process.kill()
            process.wait()


@pytest.mark.parametrize("address", ["local:0", "local:two"])
def test_a_number_of_workers_is_a_number(address: str, labour: ModuleType) -> None:
    with pytest.raises(ConfigError, match="expected local:N"), cluster(address):
        pass


def test_nobody_there_is_one_line(labour: ModuleType) -> None:
    with (
        pytest.raises(ConfigError, match=r"no scheduler answers at tcp://127\.0\.0\.1:1"),
        cluster("tcp://127.0.0.1:1"),
    ):
        pass


def test_tls_files_are_three_and_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected three files"):
        TlsFiles.of_words("ca.pem")
    with pytest.raises(ConfigError, match=r"ca\.pem is not a file"):
        TlsFiles.of_words(",".join(str(tmp_path / name) for name in ("ca.pem", "cert.pem", "key.pem")))


def test_without_dask_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match=r"pip install 'wiclosure\[cluster\]'"), cluster("local:2"):
        pass
