"""The tutorial runs from its first cell to its last, and shows what it showed when it was committed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from .pages import REPOSITORY

TUTORIAL = REPOSITORY / "docs" / "tutorial.ipynb"


def printed(notebook: Any) -> str:
    """All text of all cells, without figures that may differ between machines."""
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    lines = "".join(output.get("text", "") for output in outputs).splitlines()
    return "\n".join(" ".join(re.sub(r"\d[\d.]*", " # ", line).split()) for line in lines if "Open3D" not in line)


def test_its_outputs_are_committed_and_light() -> None:
    notebook: Any = nbformat.read(TUTORIAL, 4)
    assert all(cell.outputs or "import" in cell.source for cell in notebook.cells if cell.cell_type == "code")
    assert TUTORIAL.stat().st_size < 300_000


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # what Jupyter's own libraries warn of
def test_it_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))
    notebook: Any = nbformat.read(TUTORIAL, 4)
    committed = printed(notebook)
    NotebookClient(
        notebook, timeout=540, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    assert printed(notebook) == committed
