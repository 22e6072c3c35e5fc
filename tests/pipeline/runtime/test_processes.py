"""Work side by side; what interruptions do is tested through the command line (tests/pipeline/cli/test_run.py)."""

from __future__ import annotations

import importlib
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from wiclosure.errors import ProcessError
from wiclosure.pipeline.runtime.processes import interrupts_ignored, require_wanted, side_by_side

# A module of its own: fresh processes import what they work with by name.
LABOUR = """
import os, signal, time
from pathlib import Path

from wiclosure.pipeline.runtime.processes import require_wanted

given = {}

def begin(factor):
    given["factor"] = factor

def multiply(item):
    return item * given["factor"], os.getpid()

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


def test_results_come_in_the_order_of_the_items_from_processes_that_were_given_something(labour: ModuleType) -> None:
    with side_by_side(labour.multiply, range(6), 2, begin=labour.begin, given=(10,)) as futures:
        found = [future.result() for future in futures]
    assert [value for value, _ in found] == [0, 10, 20, 30, 40, 50]
    assert os.getpid() not in {process for _, process in found}


def test_a_process_that_is_killed_is_one_sentence(labour: ModuleType) -> None:
    with (
        pytest.raises(ProcessError, match=r"killed; where memory is short, work with fewer at a time \(-j\)"),
        side_by_side(labour.die, range(2), 2, begin=labour.begin, given=(1,)) as futures,
    ):
        futures[0].result()


def test_endless_work_ends_when_nobody_waits_for_it(labour: ModuleType, tmp_path: Path) -> None:
    with (
        pytest.raises(RuntimeError, match="enough"),
        side_by_side(labour.go_on, [tmp_path], 1, begin=labour.begin, given=(1,)),
    ):
        while not (tmp_path / "begun").exists():
            time.sleep(0.01)
        raise RuntimeError("enough")
    assert (tmp_path / "ended").exists()


def test_work_in_this_process_is_always_wanted() -> None:
    require_wanted()


def test_interrupts_are_heard_again_afterwards() -> None:
    before = signal.getsignal(signal.SIGINT)
    with interrupts_ignored():
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
