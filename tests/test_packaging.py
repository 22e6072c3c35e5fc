"""The wheel and the source distribution hold everything, and install and run in a clean environment."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from wiclosure import __version__

REPOSITORY = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
FOLDERS: dict[str, str] = PROJECT["tool"]["setuptools"]["package-dir"]
PACKAGES: list[str] = PROJECT["tool"]["setuptools"]["packages"]
MOST_MODULES = 14
"""Directly in one folder: more and nobody finds anything; what belongs together gets a sub-package."""


def run(*command: str | Path, **environment: str) -> str:
    done = subprocess.run(
        [str(part) for part in command],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def name_in_wheel(file: Path) -> str | None:
    """Where a tracked file belongs in the wheel, by the longest mapped folder that it lies in; None: it does not."""
    if file.suffix not in {".py", ".yaml", ".typed", ".msg", ".xml", ".txt"}:
        return None
    mapped = [(package, folder) for package, folder in FOLDERS.items() if file.is_relative_to(folder)]
    if not mapped:
        return None
    package, folder = max(mapped, key=lambda found: len(found[1]))
    return f"{package.replace('.', '/')}/{file.relative_to(folder)}"


def test_every_package_folder_is_listed() -> None:
    found = set()
    for package, folder in FOLDERS.items():
        for init in (REPOSITORY / folder).rglob("__init__.py"):
            if init.is_relative_to(REPOSITORY / "src/wiclosure") and any(
                parent.is_symlink() for parent in init.parents if parent.is_relative_to(REPOSITORY)
            ):
                continue
            inner = init.parent.relative_to(REPOSITORY / folder).parts
            found.add(".".join([package, *inner]))
    assert found == set(PACKAGES)


@pytest.mark.parametrize("room", ["frontends", "pipeline", "simulation", "wiclosure_filter"])
def test_no_folder_is_a_drawer(room: str) -> None:
    folders = [init.parent for init in (REPOSITORY / room).rglob("__init__.py")]
    counts = {str(f.relative_to(REPOSITORY)): len([m for m in f.glob("*.py") if m.stem != "__init__"]) for f in folders}
    assert {folder: count for folder, count in counts.items() if count > MOST_MODULES} == {}


def test_every_link_for_type_checkers_resolves() -> None:
    links = [path for path in (REPOSITORY / "src/wiclosure").iterdir() if path.is_symlink()]
    assert {f"wiclosure.{link.name}" for link in links} == {
        package for package, folder in FOLDERS.items() if not folder.startswith("src/")
    }
    for link in links:
        assert link.resolve() == REPOSITORY / FOLDERS[f"wiclosure.{link.name}"]


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Wheel and sdist, built from a copy of the files that git tracks."""
    folder = tmp_path_factory.mktemp("distributions")
    source = folder / "source"
    run("git", "-C", REPOSITORY, "checkout-index", "--all", f"--prefix={source}/")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder / "dist", source)
    (wheel,) = (folder / "dist").glob("*.whl")
    (sdist,) = (folder / "dist").glob("*.tar.gz")
    return wheel, sdist


@pytest.mark.slow
def test_distributions_hold_all_modules_and_presets(distributions: tuple[Path, Path]) -> None:
    wheel, sdist = distributions
    in_wheel = set(zipfile.ZipFile(wheel).namelist())
    with tarfile.open(sdist) as archive:
        in_sdist = {name.partition("/")[2] for name in archive.getnames()}
    tracked = [Path(line) for line in run("git", "-C", REPOSITORY, "ls-files").splitlines()]
    expected = {name: file for file in tracked if (name := name_in_wheel(file)) is not None}
    assert {str(Path(name).parent) for name in expected} >= {package.replace(".", "/") for package in PACKAGES}
    assert not set(expected) - in_wheel
    assert not {str(file) for file in expected.values()} - in_sdist
    assert f"wiclosure-{__version__}.dist-info/METADATA" in in_wheel
    page = Path("pipeline/report/html")
    assert {f"wiclosure/{page}/assets/report.{kind}" for kind in ("js", "css")} <= in_wheel
    assert {str(file) for file in tracked if file.is_relative_to(page / "source")} <= in_sdist
    assert not any(name.startswith(("pipeline/", "configs/", "tests/")) for name in in_wheel)


@dataclass(frozen=True)
class Installed:
    """A clean environment with one distribution.  A path entry shows it our dependencies, not our editable install."""

    folder: Path

    def run(self, command: str, *words: str | Path, **environment: str) -> str:
        return run(self.folder / "bin" / command, *words, PYTHONPATH=sysconfig.get_paths()["purelib"], **environment)


@pytest.fixture(scope="module", params=[0, 1], ids=["wheel", "sdist"])
def installed(
    request: pytest.FixtureRequest, distributions: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory
) -> Installed:
    clean = Installed(tmp_path_factory.mktemp("installed") / "clean")
    run(sys.executable, "-m", "venv", clean.folder)
    offline = ("--no-deps", "--no-index", "--no-build-isolation", "--ignore-installed")
    clean.run("python", "-m", "pip", "install", *offline, distributions[request.param])
    return clean


@pytest.mark.slow
def test_distributions_run_in_a_clean_environment(installed: Installed) -> None:
    where = installed.run("python", "-c", "import wiclosure.pipeline.cli as m; print(m.__file__)")
    assert Path(where.strip()).is_relative_to(installed.folder)
    assert "distance_m" in installed.run("wiclosure", "dump-config")


@pytest.mark.slow
@pytest.mark.parametrize("installed", [0], ids=["wheel"], indirect=True)
def test_the_demo_runs_from_the_wheel(installed: Installed, tmp_path: Path) -> None:
    """What `make release-check` does, with the dependencies of this environment."""
    installed.run("wiclosure", "demo", "--quiet", "--out", tmp_path / "demo", WICLOSURE_CACHE=str(tmp_path / "cache"))
    metrics = json.loads((tmp_path / "demo/wiclosure/metrics.json").read_text())
    assert len(metrics["components"]) == 1
    assert metrics["closures"]["accepted_false"] == 0
    assert (tmp_path / "demo/report.html").stat().st_size < 3e6


def test_the_citation_names_this_version_and_licence() -> None:
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text())
    assert citation["version"] == __version__
    assert citation["license"] in PROJECT["project"]["license"]
    assert citation["cff-version"] == "1.2.0"


def test_every_python_that_is_promised_is_tried() -> None:
    """Classifiers and continuous integration name the same versions."""
    prefix = "Programming Language :: Python :: 3."
    promised = {c.rpartition(" ")[2] for c in PROJECT["project"]["classifiers"] if c.startswith(prefix)}
    workflow = yaml.safe_load((REPOSITORY / ".github/workflows/ci.yml").read_text())
    assert promised == set(workflow["jobs"]["check"]["strategy"]["matrix"]["python"])


def test_all_holds_every_extra_of_users() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    held = " ".join(extras["all"])
    for name in set(extras) - {"all", "dev", "docs"}:
        assert re.search(rf"\b{name}\b", held), name


@pytest.mark.parametrize("path", sorted((REPOSITORY / ".github/ISSUE_TEMPLATE").glob("*.yml")), ids=lambda p: p.stem)
def test_issue_templates_are_forms(path: Path) -> None:
    form = yaml.safe_load(path.read_text())
    if path.stem != "config":
        assert {"name", "description", "body"} <= set(form)
        assert len({part["id"] for part in form["body"]}) == len(form["body"])
