"""The Python of README and docs runs, and imports from `wiclosure` itself; docs/simulation.md has tests of its own."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from wiclosure import Closure, KeyframeId, Scan, Trajectory, se3
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder

REPOSITORY = Path(__file__).resolve().parent.parent
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").glob("*.md"))]


def blocks(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def test_examples_import_from_the_public_api_only() -> None:
    sources = {page.name: "\n".join(blocks(page)) for page in PAGES}
    sources |= {file.name: file.read_text(encoding="utf-8") for file in (REPOSITORY / "examples").glob("*.py")}
    assert sum(map(bool, sources.values())) >= 4
    for name, source in sources.items():
        assert re.findall(r"(?:from|import) (wiclosure\.\S+)", source) == [], name


def test_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))
    for seed, robot in enumerate(("alpha", "beta")):
        points = np.random.default_rng(seed).uniform(-10, 10, (2000, 3))
        write_kitti_folder(robot, [Scan(10**9 + k * 10**8, points) for k in range(2)])
    Path("dataset.yaml").write_text("robots: {alpha: {scans: alpha}, beta: {scans: beta}}")
    example = runpy.run_path(str(REPOSITORY / "examples" / "plug_in.py"))
    names = ("stamps_ns", "odometry", "measurements")
    scope = {name: example[name] for name in names} | {"rows": np.arange(3)}
    (block,) = blocks(REPOSITORY / "README.md")
    exec(compile(block, "README.md", "exec"), scope)
    assert scope["T_a_b"].shape == (3, 4, 4)
    assert list(scope["run"].merged) == ["alpha", "beta"]


def test_the_page_on_the_back_end_runs() -> None:
    poses = se3.from_yaw(0.1 * np.arange(30), np.arange(30)[:, None] * [1.0, 0.2, 0.0])
    stamps_ns = np.arange(30) * 10**9
    odometry = {name: Trajectory(name, stamps_ns, poses) for name in ("alpha", "beta")}
    covariance = np.diag(np.repeat([1e-4, 1e-2], 3))
    closures = [
        Closure.from_measurement(KeyframeId("alpha", k), KeyframeId("beta", k), np.eye(4), covariance)
        for k in range(0, 30, 2)
    ]
    so_far = {name: trajectory.subset(np.arange(20)) for name, trajectory in odometry.items()}
    scope = {"closures": closures, "closure": closures[3], "odometry": odometry}
    scope |= {"odometry_so_far": so_far, "odometry_grown": odometry}
    (block,) = blocks(REPOSITORY / "docs" / "back_end.md")
    exec(compile(block, "docs/back_end.md", "exec"), scope)
    np.testing.assert_allclose(scope["result"].trajectories["beta"].poses, poses, atol=1e-6)
