from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.pipeline.runtime.paths import exists, expanded, is_file, is_folder


@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "~nobody-of-that-name/x", "absent", "\udcff"])
def test_names_that_no_file_has_lie_nowhere(tmp_path: Path, name: str) -> None:
    assert not exists(tmp_path / name)
    assert not is_file(tmp_path / name)
    assert str(expanded(name)) == name


def test_files_and_folders(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("x")
    assert exists(tmp_path)
    assert not is_file(tmp_path)
    assert is_file(tmp_path / "a")
    assert is_folder(tmp_path)
    assert not is_folder(tmp_path / "a")
    assert not is_folder(Path("/proc/1/cwd/absent"))
    assert expanded("~/x") == Path.home() / "x"
