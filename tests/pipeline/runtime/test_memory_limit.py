from __future__ import annotations

import subprocess
import sys

import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.runtime.memory_limit import bytes_of, memory_taken

FILL = """
import sys
from wiclosure.pipeline.cli import main
import wiclosure.pipeline.data.open_inputs as opening
def fill(*_, **__):
    kept = []
    while True:
        kept.append(bytearray(b"x") * 10**7)
opening.open_inputs = fill
sys.argv = ["wiclosure", "run", "scenario:city", "--memory", "400MB", "--out", sys.argv[1], "--quiet", "--no-cache"]
main()
"""


@pytest.mark.parametrize(
    ("text", "size"), [("8GB", 8 * 2**30), ("500m", 500 * 2**20), ("1.5 GiB", 3 * 2**29), ("4096", 4096)]
)
def test_sizes(text: str, size: int) -> None:
    assert bytes_of(text) == size


def test_shares_are_of_the_machine() -> None:
    assert bytes_of("100%") > 2 * bytes_of("49%") > 0


@pytest.mark.parametrize("text", ["", "much", "0", "-1GB", "8 apples"])
def test_what_is_no_size_is_said(text: str) -> None:
    with pytest.raises(ConfigError, match="--memory"):
        bytes_of(text)


def test_memory_of_this_process_is_counted() -> None:
    before = memory_taken()
    filled = bytearray(b"x") * 10**8
    assert memory_taken() - before > 0.8 * len(filled)


def test_a_run_that_takes_more_ends_with_a_sentence(tmp_path: object) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FILL, f"{tmp_path}/out"], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "more than the limit of 419 MB (--memory): work with fewer processes" in done.stderr
