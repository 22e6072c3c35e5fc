from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path

import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.runtime.cache import (
    StageCache,
    Stock,
    _modules,
    code_digest,
    default_cache_folder,
    file_identity,
)


class Stage:
    """Counts how often it is computed."""

    def __init__(self, cache: StageCache) -> None:
        self.cache = cache
        self.computed = 0

    def __call__(self, depends_on: object) -> tuple[str, bool]:
        def compute() -> str:
            self.computed += 1
            return f"result {self.computed}"

        def save(value: str, path: Path) -> None:
            path.write_text(value)

        return self.cache.reuse("stage", depends_on, load=Path.read_text, save=save, compute=compute)


def test_same_inputs_are_computed_once(tmp_path: Path) -> None:
    stage = Stage(StageCache(tmp_path))
    assert stage({"voxel": 0.5}) == ("result 1", False)
    assert stage({"voxel": 0.5}) == ("result 1", True)
    assert stage({"voxel": 0.6}) == ("result 2", False)


def test_no_folder_keeps_nothing(tmp_path: Path) -> None:
    stage = Stage(StageCache(None))
    stage(1)
    assert stage(1) == ("result 2", False)


def test_spoiled_entry_is_computed_again(tmp_path: Path) -> None:
    stage = Stage(StageCache(tmp_path))
    stage(1)
    (entry,) = tmp_path.iterdir()
    entry.write_bytes(b"\xff\xfe\xff")
    assert stage(1) == ("result 2", False)
    assert stage(1) == ("result 2", True)


def test_old_entries_go_when_the_cache_is_full(tmp_path: Path) -> None:
    stage = Stage(StageCache(tmp_path, limit_bytes=20))
    for n in range(5):
        stage(n)
    assert sum(p.stat().st_size for p in tmp_path.iterdir()) <= 20


def test_unwritable_cache_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert Stage(StageCache(tmp_path / "file" / "cache"))(1) == ("result 1", False)


def test_a_folder_named_from_here_is_the_same_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WICLOSURE_CACHE", "kept")
    assert default_cache_folder() == tmp_path / "kept"


def test_an_address_is_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WICLOSURE_CACHE", "s3://bucket/wiclosure")
    with pytest.raises(ConfigError, match="WICLOSURE_CACHE is s3://bucket/wiclosure, an address; mount it"):
        default_cache_folder()


def test_a_file_in_the_place_of_the_cache_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))
    assert default_cache_folder() == tmp_path / "cache"
    (tmp_path / "cache").write_text("mine")
    with pytest.raises(ConfigError, match=r"WICLOSURE_CACHE is .*cache, a file; name a folder, or .* --no-cache"):
        default_cache_folder()


@pytest.mark.parametrize("change", ["content", "name"])
def test_identity_follows_the_files(tmp_path: Path, change: str) -> None:
    (tmp_path / "000000.bin").write_bytes(b"12")
    before = file_identity(tmp_path)
    assert file_identity(tmp_path) == before
    if change == "content":
        (tmp_path / "000000.bin").write_bytes(b"123")
    else:
        (tmp_path / "000000.bin").rename(tmp_path / "000001.bin")
    assert file_identity(tmp_path) != before


def test_what_is_kept_is_listed_and_thrown_away_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "notes-of-the-user.txt").write_text("keep me")
    cache = StageCache(tmp_path)
    stage = Stage(cache)
    stage(1)
    stage(2)
    size = sum(p.stat().st_size for p in tmp_path.glob("stage-*"))
    assert cache.stock() == (Stock("stage", 2, size),)
    cache.clear()
    assert cache.stock() == ()
    assert [p.name for p in tmp_path.iterdir()] == ["notes-of-the-user.txt"]


def test_the_entry_used_longest_ago_goes_first(tmp_path: Path) -> None:
    stage = Stage(StageCache(tmp_path, limit_bytes=20))
    for age, n in enumerate((1, 2)):
        stage(n)
        for entry in tmp_path.iterdir():
            os.utime(entry, ns=(entry.stat().st_atime_ns, entry.stat().st_mtime_ns - (2 - age) * 10**9))
    stage(1)  # used again: now the younger one
    stage(3)
    assert (stage(1)[1], stage(2)[1]) == (True, False)


@pytest.mark.parametrize(("text", "size"), [("0.5", 2**29), ("12", 12 * 2**30)])
def test_the_environment_bounds_the_size(monkeypatch: pytest.MonkeyPatch, text: str, size: int) -> None:
    monkeypatch.setenv("WICLOSURE_CACHE_GB", text)
    assert StageCache(None).limit_bytes == size


@pytest.mark.parametrize("text", ["", "much", "-1", "inf", "nan"])
def test_a_size_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("WICLOSURE_CACHE_GB", text)
    with pytest.raises(ConfigError, match="WICLOSURE_CACHE_GB"):
        StageCache(None)


def test_the_code_digest_covers_sub_packages_but_not_the_rooms_of_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "bench_of_tools"
    (package / "drawer").mkdir(parents=True)
    for module in (package / "__init__.py", package / "drawer" / "__init__.py", package / "drawer" / "saw.py"):
        module.write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    before = code_digest((package.name,))
    (package / "drawer" / "saw.py").write_text("SHARP = True\n")
    code_digest.cache_clear()
    assert code_digest((package.name,)) != before
    assert not any("pipeline" in str(module) for module in _modules(files("wiclosure"), deep=False))
