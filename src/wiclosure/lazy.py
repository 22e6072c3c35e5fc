"""Packages that offer names from their modules without importing these until a name is asked for."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def offer(package: str, modules: Mapping[str, str]) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package (PEP 562).

    Type checkers and editors do not see these: the package repeats the names as imports under `if TYPE_CHECKING`.

    Args:
        package: its `__name__`.
        modules: by the full name of a module, the names that are imported from it, separated by spaces.
    """
    homes = {name: module for module, names in modules.items() for name in names.split()}

    def get(name: str) -> Any:
        own = sys.modules[package]
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=own)
        value = getattr(import_module(homes[name]), name)
        setattr(own, name, value)  # found directly the next time
        return value

    def offered() -> list[str]:
        return sorted({*vars(sys.modules[package]), *homes})

    return get, offered, sorted(homes)
