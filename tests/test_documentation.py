"""README and docs are true: their Python runs and imports from `wiclosure` itself, their links lead somewhere."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
import typer.main

from wiclosure import Closure, KeyframeId, Scan, Trajectory, se3
from wiclosure.pipeline.cli.commands import app
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder

REPOSITORY = Path(__file__).resolve().parent.parent
DOCS = sorted((REPOSITORY / "docs").glob("*.md"))
PAGES = [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *DOCS]
Scope: TypeAlias = dict[str, Any]


def blocks(page: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def _readme() -> Scope:
    """Two recordings and their data set, where the page is run."""
    for seed, robot in enumerate(("alpha", "beta")):
        points = np.random.default_rng(seed).uniform(-10, 10, (2000, 3))
        write_kitti_folder(robot, [Scan(10**9 + k * 10**8, points) for k in range(2)])
    Path("dataset.yaml").write_text("robots: {alpha: {scans: alpha}, beta: {scans: beta}}")
    return {}


def _plug_in() -> Scope:
    """The arrays of the example that the page shows a part of."""
    example = runpy.run_path(str(REPOSITORY / "examples" / "plug_in.py"))
    return {name: example[name] for name in ("stamps_ns", "odometry", "measurements")} | {"rows": np.arange(3)}


def _back_end() -> Scope:
    """Two robots on one path, and true closures between them."""
    poses = se3.from_yaw(0.1 * np.arange(30), np.arange(30)[:, None] * [1.0, 0.2, 0.0])
    odometry = {name: Trajectory(name, np.arange(30) * 10**9, poses) for name in ("alpha", "beta")}
    covariance = np.diag(np.repeat([1e-4, 1e-2], 3))
    closures = [
        Closure.from_measurement(KeyframeId("alpha", k), KeyframeId("beta", k), np.eye(4), covariance)
        for k in range(0, 30, 2)
    ]
    so_far = {name: trajectory.subset(np.arange(20)) for name, trajectory in odometry.items()}
    return {
        "closures": closures,
        "closure": closures[3],
        "odometry": odometry,
        "odometry_so_far": so_far,
        "odometry_grown": odometry,
    }


GIVEN: Mapping[str, Callable[[], Scope]] = {
    "README.md": _readme,
    "plug_in.md": _plug_in,
    "back_end.md": _back_end,
    "simulation.md": dict,
}
"""What the Python of each page takes for granted; a page that is not here must have none."""


@pytest.fixture
def scope_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Scope]:
    """Runs the Python of a page, and gives the names that it leaves."""

    def scope_of(name: str) -> Scope:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))
        scope = GIVEN[name]()
        (page,) = (page for page in PAGES if page.name == name)
        for block in blocks(page):
            exec(compile(block, name, "exec"), scope)
        return scope

    return scope_of


def test_every_page_with_python_is_run() -> None:
    assert {page.name for page in PAGES if blocks(page)} == set(GIVEN)


def test_examples_import_from_the_public_api_only() -> None:
    sources = {page.name: "\n".join(blocks(page)) for page in PAGES}
    sources |= {file.name: file.read_text(encoding="utf-8") for file in (REPOSITORY / "examples").glob("*.py")}
    for name, source in sources.items():
        assert re.findall(r"(?:from|import) (wiclosure\.\S+)", source) == [], name


def test_the_readme(scope_of: Callable[[str], Scope]) -> None:
    assert list(scope_of("README.md")["run"].merged) == ["alpha", "beta"]


def test_the_filter_in_front_of_another_pipeline(scope_of: Callable[[str], Scope]) -> None:
    assert scope_of("plug_in.md")["T_a_b"].shape == (3, 4, 4)


def test_the_back_end(scope_of: Callable[[str], Scope]) -> None:
    scope = scope_of("back_end.md")
    poses = scope["odometry"]["beta"].poses
    np.testing.assert_allclose(scope["result"].trajectories["beta"].poses, poses, atol=1e-6)


def test_simulated_worlds(scope_of: Callable[[str], Scope]) -> None:
    scope = scope_of("simulation.md")
    assert len(scope["scan"].points) > 1000
    assert scope["log"].measurements


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    targets = [target.partition("#") for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]
    missing = [target for target, _, _ in targets if not (page.parent / target).exists()]
    assert missing == []
    for target, _, heading in targets:
        if heading:
            other = text if not target else (page.parent / target).read_text(encoding="utf-8")
            assert heading in _anchors(other), f"{target}#{heading}"


def _anchors(text: str) -> set[str]:
    """What a forge makes of the headings."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_index_has_every_page() -> None:
    index = (REPOSITORY / "docs" / "index.md").read_text(encoding="utf-8")
    assert {page.name for page in DOCS} - {"index.md"} <= set(re.findall(r"\]\((\w+\.md)\)", index))


def test_commands_of_the_pages_exist() -> None:
    known = set(typer.main.get_command(app).commands)  # type: ignore[attr-defined]  # a group
    for page in PAGES:
        shell = "\n".join(re.findall(r"```(?:sh|bash)?\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL))
        assert set(re.findall(r"^wiclosure ([a-z][\w-]*)", shell, re.MULTILINE)) <= known, page.name


def test_the_readme_is_short() -> None:
    assert len((REPOSITORY / "README.md").read_text(encoding="utf-8").splitlines()) <= 150
