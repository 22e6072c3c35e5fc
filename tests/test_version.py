from __future__ import annotations

import importlib
import tomllib
from importlib.metadata import version
from pathlib import Path

from packaging.version import Version

import wiclosure
from wiclosure.version import __version__

PYPROJECT = Path(__file__).resolve().parent.parent / "pyproject.toml"


def test_the_version_is_the_installed_one():
    assert version("wiclosure") == __version__ == wiclosure.__version__


def test_the_build_reads_the_version_from_where_the_code_does():
    pyproject = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))
    assert "version" in pyproject["project"]["dynamic"]
    assert "version" not in pyproject["project"]
    module, attribute = pyproject["tool"]["setuptools"]["dynamic"]["version"]["attr"].rsplit(".", 1)
    assert getattr(importlib.import_module(module), attribute) == __version__


def test_the_version_is_written_as_packages_are_named():
    assert str(Version(__version__)) == __version__
