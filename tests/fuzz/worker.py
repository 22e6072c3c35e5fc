"""Reads mutated copies of one kind of file, in a process that the system bounds.

    python worker.py KINDS COUNT SEED SCRATCH     (kinds separated by semicolons)

Prints one JSON object a kind: what the copies came to, and every case that is none of: refused in one line that names
the file; read; read with a warning.  Those cases are kept in SCRATCH.
"""

from __future__ import annotations

import json
import logging
import resource
import shutil
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from mutations import mutated  # type: ignore[import-not-found]
from readers import READERS, Reader  # type: ignore[import-not-found]

from wiclosure.errors import WiclosureError

MEMORY_BYTES = 2 * 10**9
LONGEST_S = 10


class Hang(BaseException):
    """A case took too long."""


class Said(logging.Handler):
    """Counts what is said to the user."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.count = 0

    def emit(self, record: logging.LogRecord) -> None:
        record.getMessage()
        self.count += 1


@contextmanager
def limited_time() -> Iterator[None]:
    def hang(*_: object) -> None:
        raise Hang

    signal.signal(signal.SIGALRM, hang)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def outcome(reader: Reader, folder: Path, file: Path, said: Said) -> str:
    """What a copy comes to; more than a word: what is wrong."""
    said.count = 0
    try:
        with limited_time():
            numbers = [np.asarray(n, float) for n in reader.read(folder)]
    except WiclosureError as error:
        line = str(error)
        if "\n" in line:
            return f"more than a line: {line[:300]}"
        named = file.name in line or file.parent.name in line or "--set" in line or "configuration" in line
        return "refused" if named else f"names no file: {line[:300]}"
    except Hang:
        return f"hang: {traceback.format_exc()[-600:]}"
    except Exception:
        return f"traceback: {traceback.format_exc()[-1500:]}"
    size = max((float(np.abs(n).max(initial=0.0)) for n in numbers), default=0.0)  # NaN stays NaN
    if said.count:
        return "read with a remark"
    return "read" if size <= reader.bound else f"garbage in silence: {size}"


def run(kind: str, count: int, seed: int, scratch: Path) -> dict[str, object]:
    reader, said = READERS[kind], Said()
    logging.getLogger().handlers = [said]
    home = scratch / kind.replace(" ", "-").replace(",", "")
    home.mkdir(parents=True)
    files = [file.relative_to(home) for file in reader.make(home)]
    originals = {file: (home / file).read_bytes() for file in files}
    assert list(reader.read(home)) is not None  # raises what is wrong with the originals
    counts: Counter[str] = Counter()
    wrong, slowest = [], 0.0
    for case in range(count):
        rng = np.random.default_rng([seed, case, sum(kind.encode())])
        file = files[int(rng.integers(0, len(files)))]
        (home / file).write_bytes(mutated(originals[file], rng, is_text=reader.is_text))
        started = time.monotonic()
        came_to = outcome(reader, home, home / file, said)
        slowest = max(slowest, time.monotonic() - started)
        counts[came_to.partition(":")[0]] += 1
        if ":" in came_to:
            kept = scratch / f"{home.name}-{seed}-{case}-{file.name}"
            shutil.copy(home / file, kept)
            wrong.append({"kind": kind, "seed": seed, "case": case, "file": str(kept), "what": came_to})
        (home / file).write_bytes(originals[file])
    shutil.rmtree(home)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {"kind": kind, "counts": counts, "slowest_s": round(slowest, 2), "peak_bytes": peak, "wrong": wrong}


def main() -> None:
    """See above."""
    kinds, count, seed, scratch = sys.argv[1].split(";"), int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    warnings.simplefilter("error")
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + MEMORY_BYTES,) * 2)
    resource.setrlimit(resource.RLIMIT_CPU, (60 + count * len(kinds),) * 2)
    for kind in kinds:
        print(json.dumps(run(kind, count, seed, scratch)), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
