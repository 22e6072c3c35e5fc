"""Work side by side; what interruptions do is tested through the command line (tests/pipeline/cli/test_run.py)."""

from __future__ import annotations

import os
import signal
import time
from logging import getLogger
from multiprocessing import active_children
from pathlib import Path
from threading import Thread
from types import ModuleType

import pytest

from wiclosure.errors import ProcessError
from wiclosure.pipeline.runtime.processes import Processes, interrupts_ignored
from wiclosure.workers import require_wanted


def test_results_come_with_their_numbers_from_other_processes(labour: ModuleType) -> None:
    found = dict(Processes(2).each(labour.process_id, range(6)))
    assert sorted(found) == list(range(6))
    assert os.getpid() not in found.values()


def test_processes_are_kept_for_the_next_work_and_no_longer_than_who_asked_for_them(labour: ModuleType) -> None:
    workers = Processes(1)
    first, second = (dict(workers.each(labour.process_id, range(2))) for _ in range(2))
    assert first == second
    assert len(active_children()) == 1
    del workers
    assert active_children() == []


def test_those_that_others_left_nothing_to_do_end_in_peace(labour: ModuleType, capfd: pytest.CaptureFixture) -> None:
    for _ in range(3):
        dict(Processes(4).each(labour.process_id, range(4)))  # the first may do all before the last has started
        assert active_children() == []
    assert capfd.readouterr().err == ""


def test_after_a_process_was_killed_others_begin(labour: ModuleType) -> None:
    workers = Processes(2)
    with pytest.raises(ProcessError):
        dict(workers.each(labour.die, range(2)))
    assert active_children() == []
    assert len(dict(workers.each(labour.process_id, range(3)))) == 3


def test_news_come_to_those_who_asked_for_the_work(labour: ModuleType) -> None:
    workers = Processes(1)
    for seed in (3, 4):
        heard: list[tuple[object, ...]] = []
        dict(workers.each(labour.solve, [seed, seed], told=lambda *news, heard=heard: heard.append(news)))
        assert heard == [("seed", seed)] * 2


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


def test_warnings_of_processes_are_shown_as_those_of_this_one(capfd: pytest.CaptureFixture[str]) -> None:
    warn = getLogger("wiclosure.pipeline.runtime.cache").warning
    assert dict(Processes(1).each(warn, ["odometry is not kept"])) == {0: None}
    assert capfd.readouterr().err == "wiclosure: warning: odometry is not kept\n"
