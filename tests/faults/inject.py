"""Runs that meet full disks, kills, and inputs that change or vanish: what they leave, and what comes next.

    python inject.py COUNT SEED SCRATCH

Each injection runs `wiclosure run` in a forked process under one fault, and then again without.  Prints one JSON
object: how many of each fault there were, how they ended, and everything that is not as it must be.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import shutil
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from wiclosure.drift import DriftModel
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.cli import main as command
from wiclosure.pipeline.data.dataset_writer import write_ros1_bag
from wiclosure.types import Scan, Trajectory, WirelessLog, WirelessMeasurement

LONGEST_S = 120.0
SAME = ("alpha.tum", "beta.tum", "candidates.csv", "closures.csv", "graph.g2o", "map.ply")
"""Files that are the same for the same input; others hold times."""


def room(x: float, y: float, rng: np.random.Generator) -> np.ndarray:
    """Points on the walls of a hall with pillars, seen from a place in it."""
    along, height = rng.uniform(-20, 20, 2500), rng.uniform(-1, 4, 2500)
    side = rng.integers(0, 4, 2500)
    walls = np.where(side == 0, 1, 0)[:, None] * np.column_stack([along, np.full(2500, 12.0), height])
    walls += np.where(side == 1, 1, 0)[:, None] * np.column_stack([along, np.full(2500, -15.0), height])
    walls += np.where(side == 2, 1, 0)[:, None] * np.column_stack([np.full(2500, 20.0), along * 0.7, height])
    walls += np.where(side == 3, 1, 0)[:, None] * np.column_stack([np.full(2500, -20.0), along * 0.7, height])
    return np.asarray(walls - [x, y, 0])


def write_data(folder: Path) -> None:
    """Two robots that drive along each other's way."""
    rng = np.random.default_rng(0)
    for robot, y in (("alpha", 0.0), ("beta", 2.0)):
        scans = [Scan(10**18 + n * 10**8, room(n * 0.5 - 3, y, rng)) for n in range(12)]
        write_ros1_bag(folder / f"{robot}.bag", scans)
        poses = np.tile(np.eye(4), (12, 1, 1))
        poses[:, 0, 3], poses[:, 1, 3] = np.arange(12) * 0.5 - 3, y
        write_tum(folder / f"{robot}.tum", Trajectory(robot, 10**18 + np.arange(12) * 10**8, poses, DriftModel()))
    heard = tuple(WirelessMeasurement(10**18 + n * 10**8, "alpha", "beta", 2.0, 0.1) for n in range(12))
    write_wireless_log(folder / "radio.jsonl", WirelessLog(heard))
    robots = "".join(f"  {robot}: {{scans: {robot}.bag, ground_truth: {robot}.tum}}\n" for robot in ("alpha", "beta"))
    (folder / "dataset.yaml").write_text(f"robots:\n{robots}wireless: [radio.jsonl]\n")


class Place:
    """Folders of one injection."""

    def __init__(self, home: Path, data: Path) -> None:
        self.home, self.data = home, home / "data"
        self.results, self.cache, self.temporary = home / "results", home / "cache", home / "tmp"
        shutil.copytree(data, self.data)
        for folder in (self.results, self.cache, self.temporary):
            folder.mkdir()

    @property
    def out(self) -> Path:
        return self.results / "out"

    def start(self, before: Callable[[], object] = lambda: None) -> int:
        """A process that runs; its output goes to files."""
        if pid := os.fork():
            return pid
        try:
            before()
            for number, name in ((1, "stdout"), (2, "stderr")):
                os.dup2(os.open(self.home / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
            os.environ |= {"WICLOSURE_CACHE": str(self.cache), "TMPDIR": str(self.temporary)}
            sys.argv = ["wiclosure", "run", str(self.data / "dataset.yaml"), "--out", str(self.out), "--overwrite"]
            sys.argv += ["--quiet", "--filter", "none"]
            command()
        except SystemExit as ended:
            os._exit(ended.code if isinstance(ended.code, int) else 1)
        except BaseException:
            import traceback

            traceback.print_exc()
            sys.stderr.flush()
            os._exit(70)
        os._exit(0)

    def digest(self) -> str:
        found = hashlib.sha256()
        for name in SAME:
            found.update((self.out / name).read_bytes())
        return found.hexdigest()

    def leftovers(self) -> list[str]:
        """What a finished run may not leave beside its result."""
        beside = [path for folder in (self.results, self.temporary) for path in folder.iterdir()]
        hidden = [path for path in self.cache.iterdir() if path.name.startswith(".")]
        return [str(path) for path in (*beside, *hidden) if path not in (self.out, self.results / "latest")]


def ended(pid: int) -> int:
    """Exit code; minus the number of the signal that ended it; -99 for what took too long."""
    deadline = time.monotonic() + LONGEST_S
    while time.monotonic() < deadline:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    return -99


def full(place: Place, which: str, rng: np.random.Generator) -> int:
    """The disk of one folder has little room."""
    folder = getattr(place, which)
    size = int(10 ** rng.uniform(3.7, 6.3))
    os.system(f"mount -t tmpfs -o size={size} tmpfs '{folder}'")
    try:
        return ended(place.start())
    finally:
        kept = list(folder.iterdir()) if which == "results" else []
        assert [p for p in kept if p.name.endswith(".unfinished")] == [], kept
        shutil.copytree(folder, place.home / "kept", symlinks=True)
        os.system(f"umount '{folder}'")
        shutil.copytree(place.home / "kept", folder, symlinks=True, dirs_exist_ok=True)


def no_large_files(place: Place, rng: np.random.Generator) -> int:
    """No file may grow beyond a size."""
    size = int(10 ** rng.uniform(3, 6))  # what is said on standard error is in a file, too
    return ended(place.start(lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))))


def killed(place: Place, rng: np.random.Generator, took_s: float) -> int:
    """Ended at any moment, by any means."""
    pid = place.start()
    time.sleep(float(rng.uniform(0, took_s)))
    os.kill(pid, int(rng.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT])))
    return ended(pid)


def changed(place: Place, rng: np.random.Generator, took_s: float) -> int:
    """An input vanishes, is cut or overwritten while it is read; and is back for the next run."""
    file = place.data / str(rng.choice(["alpha.bag", "beta.bag", "radio.jsonl", "alpha.tum", "dataset.yaml"]))
    content = file.read_bytes()
    pid = place.start()
    time.sleep(float(rng.uniform(0, took_s * 0.8)))
    how = int(rng.integers(0, 3))
    if how == 0:
        file.unlink()
    else:
        file.write_bytes(content[: int(rng.integers(0, len(content)))] if how == 1 else bytes(len(content)))
    code = ended(pid)
    file.write_bytes(content)
    return code


def together(place: Place) -> int:
    """Two runs with one cache and one output."""
    first, second = place.start(), place.start()
    codes = (ended(first), ended(second))
    return 0 if 0 in codes and -99 not in codes and 70 not in codes else 70


FAULTS = ("full results", "full cache", "full temporary", "no large files", "killed", "changed", "together")


def inject(fault: str, place: Place, rng: np.random.Generator, took_s: float) -> int:
    """The exit code under a fault."""
    if fault.startswith("full"):
        return full(place, fault.split()[1], rng)
    if fault == "no large files":
        return no_large_files(place, rng)
    if fault == "killed":
        return killed(place, rng, took_s)
    return changed(place, rng, took_s) if fault == "changed" else together(place)


def wrong_about(fault: str, place: Place, code: int, reference: str) -> list[str]:
    """What is not as it must be after a fault, and after the next run."""
    said = (place.home / "stderr").read_text() if (place.home / "stderr").exists() else ""
    found = []
    if code not in {0, 1, 130, -signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT, 143}:
        found.append(f"exit code {code}: {said[-800:]}")
    if code == 1 and said.count("wiclosure: error: ") != 1:
        found.append(f"not one line: {said[-800:]}")
    if code == 0 and fault not in {"changed"} and place.digest() != reference:
        found.append("another result under the fault")
    if code == 1 and fault.startswith(("full", "no")) and place.out.exists():
        found.append("something stands where the result was to be")
    again = ended(place.start())
    if again != 0:
        found.append(f"the next run ends with {again}: {(place.home / 'stderr').read_text()[-800:]}")
    elif place.digest() != reference:
        found.append("the next run has another result")
    if left := place.leftovers():
        found.append(f"left: {left}")
    return found


def main() -> None:
    """See above."""
    count, seed, scratch = int(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3])
    scratch.mkdir(parents=True, exist_ok=True)
    (scratch / "data").mkdir()
    write_data(scratch / "data")
    place = Place(scratch / "reference", scratch / "data")
    began = time.monotonic()
    assert ended(place.start()) == 0, (place.home / "stderr").read_text()
    took_s, reference = time.monotonic() - began, place.digest()
    faults = FAULTS if os.geteuid() == 0 else tuple(fault for fault in FAULTS if not fault.startswith("full"))
    counts: Counter[str] = Counter()
    wrong: list[dict[str, object]] = []
    for number in range(count):
        rng, fault = np.random.default_rng([seed, number]), faults[number % len(faults)]
        place = Place(scratch / f"{number}", scratch / "data")
        code = inject(fault, place, rng, took_s)
        counts[f"{fault}: {code}"] += 1
        if found := wrong_about(fault, place, code, reference):
            wrong.append({"number": number, "fault": fault, "code": code, "wrong": found})
        print(number, fault, code, found, file=sys.stderr, flush=True)  # noqa: T201
        shutil.rmtree(place.home)
    print(json.dumps({"took_s": took_s, "counts": counts, "wrong": wrong}))  # noqa: T201


if __name__ == "__main__":
    main()
