"""What `import wiclosure` and its rooms offer: all of it there, nothing loaded before it is asked for."""

from __future__ import annotations

import ast
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = ("wiclosure", "wiclosure.backends", "wiclosure.formats", "wiclosure.frontends", "wiclosure.pipeline")


@pytest.mark.parametrize("package", PACKAGES)
def test_every_name_is_there(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__all__
    for name in module.__all__:
        assert getattr(module, name) is not None
        assert name in dir(module)
        # A module of that name would take its place as soon as anybody imports it.
        assert importlib.util.find_spec(f"{package}.{name}") is None


@pytest.mark.parametrize("package", PACKAGES)
def test_type_checkers_see_the_same_names_from_the_same_places(package: str) -> None:
    module = importlib.import_module(package)
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    (checked,) = (node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    imports = [node for node in checked.body if isinstance(node, ast.ImportFrom)]
    seen = {alias.asname: (node.module, alias.name) for node in imports for alias in node.names}
    assert sorted(map(str, seen)) == module.__all__
    for name, (home, original) in seen.items():
        assert name == original  # without "as", it would be private to the package
        assert getattr(importlib.import_module(str(home)), original) is getattr(module, original)


def test_importing_it_loads_nothing_heavy() -> None:
    code = "import sys, wiclosure; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert not {"numpy", "scipy", "pydantic", "gtsam", "open3d", "typer", "wiclosure.types"} & set(loaded)


def test_the_filter_and_the_nouns_load_neither_lidar_nor_drawing_libraries() -> None:
    code = "import sys; from wiclosure import Trajectory, make_filter; make_filter('wiclosure'); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert not {"open3d", "kiss_icp", "small_gicp", "rosbags", "typer", "matplotlib"} & set(loaded)


def test_a_name_that_is_not_there_is_an_error_that_names_it() -> None:
    with pytest.raises(AttributeError, match=r"module 'wiclosure' has no attribute 'Trajectroy'"):
        _ = importlib.import_module("wiclosure").Trajectroy
    with pytest.raises(ImportError, match="cannot import name 'Trajectroy' from 'wiclosure'"):
        exec("from wiclosure import Trajectroy")
