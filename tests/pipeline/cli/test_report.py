from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.types import Scan

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def recordings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two robots in an empty folder, with a cache of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))
    for seed, robot in enumerate(("alpha", "beta")):
        points = np.random.default_rng(seed).uniform(-10, 10, (2000, 3))
        write_kitti_folder(robot, [Scan(10**9 + k * 10**8, points) for k in range(3)])


def test_the_page_of_a_run_is_written_again(wiclosure: Call) -> None:
    assert wiclosure("run", "alpha", "beta", "--out", "out", "--quiet")[0] == 0
    page = Path("out/report.html")
    before = page.read_text(encoding="utf-8")
    assert "alpha and beta: run with the filter wiclosure" in before
    page.write_text(before.replace("</style>", "/* older */</style>"), encoding="utf-8")
    assert wiclosure("report", "out") == (0, "report in out/report.html\n", "")
    assert page.read_text(encoding="utf-8") == before


def test_a_folder_without_a_report_is_named(wiclosure: Call) -> None:
    code, _, err = wiclosure("report", "alpha")
    assert code == 1
    assert "alpha holds no report.html" in err
