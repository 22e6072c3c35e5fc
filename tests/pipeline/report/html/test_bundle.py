"""What draws the page is what its sources make."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import pytest

HTML = Path(__file__).resolve().parents[4] / "pipeline/report/html"
NAMES = ("report.js", "report.css", "LICENSES.txt")


def test_licences_of_all_that_is_bundled_go_along() -> None:
    assets = files("wiclosure.pipeline.report.html") / "assets"
    licences = (assets / "LICENSES.txt").read_text(encoding="utf-8")
    imported = {
        name.split("/")[0]
        for source in (HTML / "source/src").iterdir()
        for name in re.findall(r'(?:from|@import) "([^."][^"]*)"', source.read_text(encoding="utf-8"))
    }
    assert imported == {"three", "uplot"}
    for name in imported:
        assert re.search(rf"^{name} [\d.]+$", licences, re.MULTILINE)
    assert licences.count("MIT License") == len(imported)


def test_nothing_is_fetched_from_elsewhere() -> None:
    assets = files("wiclosure.pipeline.report.html") / "assets"
    for name in NAMES[:2]:
        text = (assets / name).read_text(encoding="utf-8")
        assert not re.search(r"url\((?!#|data:)|@import|\bimport\(", text)


@pytest.mark.slow
def test_the_bundle_is_what_its_sources_make(tmp_path: Path) -> None:
    if shutil.which("npm") is None:
        pytest.skip("there is no npm")
    source = shutil.copytree(HTML / "source", tmp_path / "source", ignore=shutil.ignore_patterns("node_modules"))
    if (HTML / "source/node_modules").is_dir():
        (source / "node_modules").symlink_to(HTML / "source/node_modules")
    else:
        words = ["npm", "install", "--no-package-lock", "--no-audit", "--no-fund"]
        installed = subprocess.run(words, cwd=source, capture_output=True, text=True, check=False)
        if installed.returncode:
            (pytest.fail if os.environ.get("CI") else pytest.skip)(f"npm install fails: {installed.stderr[-300:]}")
    subprocess.run(["node", "build.mjs", tmp_path / "assets"], cwd=source, check=True, capture_output=True)
    for name in NAMES:
        assert (tmp_path / "assets" / name).read_bytes() == (HTML / "assets" / name).read_bytes(), (
            f"{name} is not what the sources make; run make report-bundle and commit it"
        )
