"""Work that fresh processes and the workers of clusters find by name."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def labour() -> Iterator[ModuleType]:
    folder = str(Path(__file__).parent / "at_work")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.setenv("PYTHONPATH", folder, prepend=":")
        yield importlib.import_module("labour")
