from __future__ import annotations

import sys
from types import ModuleType

import pytest

from wiclosure.lazy import offer


@pytest.fixture
def package(monkeypatch):
    """A package that offers names of two modules of the standard library."""
    module = ModuleType("a_package")
    module.__getattr__, module.__dir__, module.__all__ = offer(
        "a_package", {"colorsys": "rgb_to_hsv hsv_to_rgb", "this_module_does_not_exist": "missing"}
    )
    monkeypatch.setitem(sys.modules, "a_package", module)
    monkeypatch.delitem(sys.modules, "colorsys", raising=False)
    return module


def test_a_module_is_imported_when_a_name_of_it_is_asked_for(package):
    assert package.__all__ == ["hsv_to_rgb", "missing", "rgb_to_hsv"]
    assert {"hsv_to_rgb", "rgb_to_hsv", "missing"} <= set(dir(package))
    assert "colorsys" not in sys.modules
    assert package.rgb_to_hsv(1.0, 0.0, 0.0) == (0.0, 1.0, 1.0)
    assert "colorsys" in sys.modules


def test_a_name_that_was_found_is_kept(package):
    assert "rgb_to_hsv" not in vars(package)
    first = package.rgb_to_hsv
    assert vars(package)["rgb_to_hsv"] is first


def test_a_name_that_is_not_offered_is_an_attribute_error(package):
    with pytest.raises(AttributeError, match="module 'a_package' has no attribute 'yiq'") as raised:
        _ = package.yiq
    assert raised.value.name == "yiq"
    assert not hasattr(package, "rgb_to_yiq")  # the module has it, the package does not offer it


def test_a_module_that_cannot_be_imported_says_so_itself(package):
    with pytest.raises(ModuleNotFoundError, match="this_module_does_not_exist"):
        _ = package.missing
