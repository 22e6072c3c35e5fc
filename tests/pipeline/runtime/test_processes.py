"""Work side by side; what interruptions do is tested through the command line (tests/pipeline/cli/test_run.py)."""

from __future__ import annotations

import importlib
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from types import ModuleType

import pytest

from wiclosure.errors import ProcessError
from wiclosure.pipeline.runtime.processes import Processes, interrupts_ignored
from wiclosure.workers import require_wanted

# A module of its own: fresh processes import what they work with by name.
LABOUR = """
import os, signal, time
from pathlib import Path

from wiclosure.workers import require_wanted, tell

def double(item):
    tell("half", item)
    return 2 * item, os.getpid()

def die(item):
    os.kill(os.getpid(), signal.SIGKILL)

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


@pytest.fixture(scope="module")
def labour(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    folder = tmp_path_factory.mktemp("labour")
    (folder / "labour.py").write_text(LABOUR)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield importlib.import_module("labour")


def test_results_come_with_their_numbers_from_other_processes(labour: ModuleType) -> None:
    heard: list[tuple[object, ...]] = []
    found = dict(Processes(2).each(labour.double, range(6), told=lambda *news: heard.append(news)))
    assert [found[number][0] for number in range(6)] == [0, 2, 4, 6, 8, 10]
    assert os.getpid() not in {process for _, process in found.values()}
    assert sorted(heard) == [("half", item) for item in range(6)]


def test_a_process_that_is_killed_is_one_sentence(labour: ModuleType) -> None:
    with pytest.raises(ProcessError, match=r"killed; where memory is short, work with fewer at a time \(-j\)"):
        dict(Processes(2).each(labour.die, range(2)))


def test_endless_work_ends_when_nobody_waits_for_it(labour: ModuleType, tmp_path: Path) -> None:
    def enough(signum: int, frame: object) -> None:
        raise RuntimeError("enough")

    def when_begun() -> None:
        while not (tmp_path / "begun").exists():
            time.sleep(0.01)
        signal.raise_signal(signal.SIGUSR1)

    before = signal.signal(signal.SIGUSR1, enough)
    try:
        Thread(target=when_begun, daemon=True).start()
        with pytest.raises(RuntimeError, match="enough"):
            dict(Processes(1).each(labour.go_on, [tmp_path]))
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert (tmp_path / "ended").exists()


def test_work_in_this_process_is_always_wanted() -> None:
    require_wanted()


def test_interrupts_are_heard_again_afterwards() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interrupts_ignored():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
