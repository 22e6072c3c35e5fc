from __future__ import annotations

import subprocess
import sys

import numpy as np

from wiclosure.memory import peak_rss_mb


def test_the_peak_is_in_megabytes_and_stays_after_memory_is_given_back():
    before = peak_rss_mb()
    assert 10 < before < 100_000  # Python with numpy, and no machine
    block = np.ones(int((before + 100) * 1e6 / 8))  # more than was ever taken, and 100 MB
    held = peak_rss_mb()
    del block
    assert before + 90 < held
    assert peak_rss_mb() >= held


def test_processes_that_have_ended_count():
    before = peak_rss_mb()
    program = f"block = bytearray(b'1') * {int((before + 60) * 1e6)}"
    subprocess.run([sys.executable, "-c", program], check=True)
    assert peak_rss_mb() > before + 40
