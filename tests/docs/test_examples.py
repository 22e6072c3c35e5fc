"""Python and console blocks of the pages run, in a folder of their own; what a console block shows is printed."""

from __future__ import annotations

import io
import re
import runpy
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest
from sybil import Document, Example, Region, Sybil
from sybil.parsers.markdown import PythonCodeBlockParser

from wiclosure import Closure, KeyframeId, Scan, Trajectory, se3
from wiclosure.pipeline import cli
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder

from .pages import PAGES, REPOSITORY, text_of

Scope: TypeAlias = dict[str, Any]
FENCE = re.compile(r"^```(\w+)(?: (\S+))?\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def files_and_commands(document: Document) -> Iterator[Region]:
    """Blocks with a file's name behind the language, and console blocks."""
    for fence in FENCE.finditer(document.text):
        language, name, text = fence.groups()
        if name:
            yield Region(fence.start(), fence.end(), (Path(name), text), write_file)
        elif language == "console":
            yield Region(fence.start(), fence.end(), text, run_commands)


def write_file(example: Example) -> None:
    path, text = example.parsed
    path.write_text(text, encoding="utf-8")


def run_commands(example: Example) -> str | None:
    """Each line after `$ ` is run; the lines below it are printed, whatever the width of the terminal."""
    run: Callable[[list[str]], str] = example.namespace["run_command"]
    for part in re.split(r"^\$ ", example.parsed, flags=re.MULTILINE)[1:]:
        command, *shown = part.strip().splitlines()
        printed = " ".join(run(shlex.split(command)).split())
        for line in shown:
            if " ".join(line.split()) not in printed:
                return f"{command}\nshould print: {line}\nprinted: {printed}"
    return None


SYBIL = Sybil([PythonCodeBlockParser(), files_and_commands])


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
    given = {name: example[name] for name in ("stamps_ns", "odometry", "measurements")}
    return given | {"rows": np.arange(3), "EXAMPLE": str(REPOSITORY / "examples" / "swarm_slam.py")}


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


GIVEN: Mapping[str, Callable[[], Scope]] = {"README.md": _readme, "plug_in.md": _plug_in, "back_end.md": _back_end}
"""What the Python of a page takes for granted."""


def holds_examples(page: Path) -> bool:
    return bool(re.search(r"^```(python|console)$", text_of(page), re.MULTILINE))


@pytest.fixture
def scope_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[Path], Scope]:
    """Runs all examples of a page in an empty folder, and gives the names that they leave."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "160")

    def run_command(words: list[str]) -> str:
        monkeypatch.setattr(sys, "argv", words)
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            cli.main()
        printed = capsys.readouterr()
        assert ended.value.code == 0, f"{shlex.join(words)}: {printed.err}"
        return printed.out + printed.err

    def scope_of(page: Path) -> Scope:
        document = SYBIL.parse(page)
        document.namespace.update(GIVEN.get(page.name, dict)(), run_command=run_command)
        for example in document.examples():
            example.evaluate()
        return document.namespace

    return scope_of


def named(name: str) -> Path:
    (page,) = (page for page in PAGES if page.name == name)
    return page


ASKED_MORE = {"README.md", "plug_in.md", "back_end.md", "simulation.md"}


@pytest.mark.parametrize(
    "page",
    [page for page in PAGES if holds_examples(page) and page.name not in ASKED_MORE],
    ids=lambda page: page.name,
)
def test_the_examples_run(page: Path, scope_of: Callable[[Path], Scope]) -> None:
    scope_of(page)


def test_the_readme(scope_of: Callable[[Path], Scope]) -> None:
    assert list(scope_of(named("README.md"))["run"].merged) == ["alpha", "beta"]


def test_the_filter_in_front_of_another_pipeline(scope_of: Callable[[Path], Scope]) -> None:
    scope = scope_of(named("plug_in.md"))
    assert scope["T_a_b"].shape == (3, 4, 4)
    assert scope["T_0_1"].shape == (4, 4)


@pytest.fixture(scope="module")
def swarm_slam() -> tuple[Scope, str]:
    """What the example leaves, and what it prints."""
    printed = io.StringIO()
    with redirect_stdout(printed):
        scope = runpy.run_path(str(REPOSITORY / "examples" / "swarm_slam.py"))
    return scope, printed.getvalue()


def test_the_page_shows_what_the_example_prints(swarm_slam: tuple[Scope, str]) -> None:
    assert f"```text\n{swarm_slam[1]}```" in text_of(named("plug_in.md"))


def test_predictions_of_the_example_are_right_whichever_robot_stands_first(swarm_slam: tuple[Scope, str]) -> None:
    example = swarm_slam[0]
    world, allowed = example["world"], example["allowed"]
    turned = [
        type(e)(e.robot1_id, e.robot1_image_id, e.robot0_id, e.robot0_image_id, e.weight) for e in example["edges"]
    ]
    found = allowed(turned, example["result"], example["NAMES"])
    assert len(found) == len(example["with_radio"])
    for edge, T_0_1 in found:
        true = se3.between(world[edge.robot0_id][edge.robot0_image_id], world[edge.robot1_id][edge.robot1_image_id])
        assert np.linalg.norm((T_0_1 - true)[:2, 3]) < 4.0


def test_the_back_end(scope_of: Callable[[Path], Scope]) -> None:
    scope = scope_of(named("back_end.md"))
    poses = scope["odometry"]["beta"].poses
    np.testing.assert_allclose(scope["result"].trajectories["beta"].poses, poses, atol=1e-6)


def test_simulated_worlds(scope_of: Callable[[Path], Scope]) -> None:
    scope = scope_of(named("simulation.md"))
    assert len(scope["scan"].points) > 1000
    assert scope["log"].measurements


def test_examples_import_from_the_public_api_only() -> None:
    sources = {page.name: "\n".join(re.findall(r"```python\n(.*?)```", text_of(page), re.DOTALL)) for page in PAGES}
    sources |= {file.name: file.read_text(encoding="utf-8") for file in (REPOSITORY / "examples").glob("*.py")}
    for name, source in sources.items():
        assert re.findall(r"(?:from|import) (wiclosure\.\S+)", source) == [], name
