"""Work for the tests of workers, which import it by name."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.workers import require_wanted, tell


def solve(seed: int) -> np.ndarray:
    tell("seed", seed)
    A = np.random.default_rng(seed).normal(size=(30, 30))
    return np.linalg.solve(A @ A.T + np.eye(30), np.ones(30))


def process_id(item: int) -> int:
    return os.getpid()


def refuse(item: int) -> int:
    if item == 3:
        raise InputError("the third is damaged")
    return item


def die(item: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def die_once(folder: Path) -> str:
    if not (folder / "died").exists():
        (folder / "died").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def go_on(folder: Path) -> None:
    (folder / "begun").touch()
    while True:
        try:
            require_wanted()
        except InterruptedError:
            (folder / "ended").touch()
            raise
        time.sleep(0.01)
