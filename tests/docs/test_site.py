"""The site builds without a warning, and asks nothing of the network."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from .pages import REPOSITORY

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As `make docs` builds it."""
    out = tmp_path_factory.mktemp("site")
    options = ["-b", "html", "-W", "--keep-going", "-q", "-E", "-d", f"{out}-trees"]
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", *options, REPOSITORY / "docs", out],
        check=False,
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    return out


def test_nothing_comes_from_elsewhere(site: Path) -> None:
    loaded = re.compile(r"<(?:script|link|img|iframe|source)\b[^>]*(?:src|href)=[\"']?(?:https?:)?//[^>]*>")
    styles = re.compile(r"(?:url\([\"']?|@import [\"'])(?:https?:)?//[^)\"']*")
    for page in site.rglob("*.html"):
        assert loaded.findall(page.read_text(encoding="utf-8")) == [], page.name
    for sheet in site.rglob("*.css"):
        assert styles.findall(sheet.read_text(encoding="utf-8")) == [], sheet.name


def test_every_page_is_there(site: Path) -> None:
    for page in (REPOSITORY / "docs").glob("*.md"):
        assert (site / f"{page.stem}.html").is_file()
    assert (site / "tutorial.html").is_file()


def test_names_of_the_api_are_targets(site: Path) -> None:
    text = (site / "api.html").read_text(encoding="utf-8")
    for name in (
        "wiclosure.run",
        "wiclosure.Trajectory.subset",
        "wiclosure.se3.between",
        "wiclosure.errors.InputError",
    ):
        assert f'id="{name}"' in text
