"""Reads two hundred mutated copies of a recording in a process of bounded memory; run by test_mutated.py.

    python mutation.py RECORDING SCRATCH SEED

Prints one line for what every copy came to, and stops at whatever is neither a line that names the file nor scans.
"""

from __future__ import annotations

import logging
import resource
import shutil
import sys
import time
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.info import recording_info
from wiclosure.pipeline.sources.open import open_source

COPIES = 200
MEMORY_BYTES = 3 * 10**9
SLOWEST_S = 20.0


def mutated(content: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Bytes changed, cut off, overwritten by zeros, repeated or moved."""
    content, size = content.copy(), len(content)
    start = int(rng.integers(0, size if rng.random() < 0.5 else min(size, 4096)))
    length = int(rng.integers(1, max(2, size // 8)))
    match int(rng.integers(0, 6)):
        case 0:
            places = rng.integers(0, size, 1 + int(rng.integers(0, 40)))
            content[places] = rng.integers(0, 256, len(places))
        case 1:
            places = rng.integers(0, min(size, 4096), 1 + int(rng.integers(0, 12)))
            content[places] = rng.integers(0, 256, len(places))
        case 2:
            return content[:start]
        case 3:
            content[start : start + length] = 0
        case 4:
            return np.concatenate([content[:start], content[start : start + length], content[start:]])
        case _:
            return np.concatenate([content[:start], content[start + length :]])
    return content


def read(path: Path, salvage: bool) -> str:
    """What a copy comes to, in one word."""
    try:
        info = recording_info(path, salvage=salvage)
        count = 0
        for scan in open_source(path, salvage=salvage):
            count += 1
            assert np.isfinite(scan.points).all()
            assert np.abs(scan.points).max(initial=0.0) < 1e9
    except InputError as error:
        said = str(error)
    else:
        announced = next((topic.count for topic in info.topics if topic.first_cloud is not None), info.count)
        assert count <= announced or salvage, (count, announced)
        return "read"
    assert path.parent.name in said or path.name in said, said
    assert "\n" not in said, said
    return "refused"


def main() -> None:
    """See above."""
    logging.disable(logging.CRITICAL)
    recording, scratch, seed = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    rng = np.random.default_rng(seed)
    content = np.fromfile(recording, np.uint8)
    counts: dict[str, int] = {}
    for number in range(COPIES):
        folder = scratch / f"copy{number}"
        folder.mkdir()
        mutated(content, rng).tofile(folder / recording.name)
        is_bag = recording.suffix in {".bag", ".mcap", ".db3"}
        for salvage in (False, True) if is_bag else (False,):
            began = time.monotonic()
            word = read(folder / recording.name if is_bag else folder, salvage)
            assert time.monotonic() - began < SLOWEST_S
            counts[word] = counts.get(word, 0) + 1
        shutil.rmtree(folder)
    print(counts)  # noqa: T201


if __name__ == "__main__":
    main()
