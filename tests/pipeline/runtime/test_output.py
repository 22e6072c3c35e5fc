from __future__ import annotations

import errno
import time
from pathlib import Path

import numpy as np
import pytest

from wiclosure.backends.merged.map_writers import write_ply
from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.errors import OutputError
from wiclosure.pipeline.runtime.output import (
    MARK,
    default_folder,
    point_latest,
    require_apart,
    require_free,
    whole_file,
    whole_folder,
    write_json,
)


def test_what_is_written_aside_is_named_as_workers_elsewhere_find_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with whole_folder(Path("run")) as scratch:
        assert scratch.is_absolute()
    assert (tmp_path / "run").is_dir()


def test_folder_appears_whole(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "run"
    with whole_folder(out) as scratch:
        (scratch / "a.txt").write_text("a")
        assert not out.exists()
    assert (out / "a.txt").read_text() == "a"
    assert list(out.parent.iterdir()) == [out]


@pytest.mark.parametrize("failure", [RuntimeError("broken"), KeyboardInterrupt()])
def test_folder_of_a_failed_run_does_not_appear(tmp_path: Path, failure: BaseException) -> None:
    with pytest.raises(type(failure)), whole_folder(tmp_path / "run") as scratch:
        (scratch / "a.txt").write_text("a")
        raise failure
    assert list(tmp_path.iterdir()) == []


def test_existing_folder_is_replaced_only_when_asked(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with whole_folder(out) as scratch:
        (scratch / "old.txt").write_text("old")
    with pytest.raises(OutputError, match="--overwrite"), whole_folder(out):
        pass
    with whole_folder(out, overwrite=True) as scratch:
        (scratch / "new.txt").write_text("new")
    assert {p.name for p in out.iterdir()} == {"new.txt", MARK}
    assert list(tmp_path.iterdir()) == [out]


def test_folders_of_others_are_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match="not written by wiclosure"), whole_folder(tmp_path, overwrite=True):
        pass
    assert (tmp_path / "thesis.tex").exists()


def test_a_result_that_appeared_meanwhile_stays(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="exists already"), whole_folder(tmp_path / "run") as mine:
        (mine / "a.txt").write_text("mine")
        with whole_folder(tmp_path / "run") as quicker:
            (quicker / "a.txt").write_text("quicker")
    assert (tmp_path / "run" / "a.txt").read_text() == "quicker"


def test_what_is_read_is_not_written_over(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="which is read"):
        require_apart(tmp_path, [tmp_path / "data" / "alpha.bag"])
    require_apart(tmp_path / "run", [tmp_path / "data" / "alpha.bag"])


def test_failed_overwrite_keeps_the_old_result(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with whole_folder(out) as scratch:
        (scratch / "old.txt").write_text("old")
    with pytest.raises(RuntimeError), whole_folder(out, overwrite=True):
        raise RuntimeError
    assert (out / "old.txt").read_text() == "old"


def test_full_disk_is_one_sentence_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"No space left.*make room"), whole_folder(tmp_path / "run"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert list(tmp_path.iterdir()) == []


def test_really_full_device(tmp_path: Path) -> None:
    """`/dev/full` fails every write as a full disk does."""
    with pytest.raises(OutputError, match="No space left"), whole_folder(tmp_path / "run") as scratch:
        (scratch / "map.ply").symlink_to("/dev/full")
        (scratch / "map.ply").write_bytes(b"0" * 100_000)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_named_by_its_own_place(tmp_path: Path) -> None:
    with (
        pytest.raises(OutputError, match=f"^cannot write {tmp_path}/run/map.ply: No space left on device"),
        whole_folder(tmp_path / "run") as scratch,
    ):
        (scratch / "map.ply").symlink_to("/dev/full")
        write_ply(MergedMap(np.zeros((9_999, 3), np.float32), np.zeros((9_999, 3), np.uint8)), scratch / "map.ply")
    with pytest.raises(OutputError, match=f"^{tmp_path}/a.txt is bad"), whole_file(tmp_path / "a.txt") as scratch:
        raise OutputError(f"{scratch} is bad")


def test_a_link_to_nowhere(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("nowhere")
    with pytest.raises(OutputError, match="link is a link to nowhere, which does not exist"):
        require_free(tmp_path / "link", overwrite=True)


def test_parent_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file is a file, so nothing"), whole_folder(tmp_path / "file" / "run"):
        pass


def test_out_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is a file"), whole_folder(tmp_path / "file", overwrite=True):
        pass


def test_file_appears_whole(tmp_path: Path) -> None:
    with whole_file(tmp_path / "a.csv") as scratch:
        scratch.write_text("1")
        assert not (tmp_path / "a.csv").exists()
    assert (tmp_path / "a.csv").read_text() == "1"
    with pytest.raises(RuntimeError), whole_file(tmp_path / "b.csv") as scratch:
        raise RuntimeError
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_latest_is_a_relative_link(tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        point_latest(tmp_path / name)
        assert (tmp_path / "latest").readlink() == Path(name)


def test_default_folders_do_not_collide(tmp_path: Path) -> None:
    first = default_folder(tmp_path)
    time.sleep(0.002)
    assert default_folder(tmp_path) != first


def test_json_is_readable_and_knows_no_infinity(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"robot": "müller", "ate_m": None})
    assert (tmp_path / "a.json").read_text(encoding="utf-8") == '{\n  "robot": "müller",\n  "ate_m": null\n}\n'
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "b.json", float("inf"))


def test_a_result_that_holds_what_others_put_there_is_not_replaced(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out) as scratch:
        (scratch / "a").mkdir()
        (scratch / "a" / "b.txt").write_text("x")
    with whole_folder(out, overwrite=True) as scratch:
        (scratch / "c.txt").write_text("x")
    for foreign in ("notes.txt", "linked"):
        if foreign == "linked":
            (out / foreign).symlink_to(tmp_path)
        else:
            (out / foreign).write_text("mine")
        with pytest.raises(OutputError, match=f"holds '{foreign}', which wiclosure did not write"):
            require_free(out, overwrite=True)
        (out / foreign).unlink()
    (out / "nested").mkdir()
    with whole_folder(out / "nested" / "other"):
        pass
    with pytest.raises(OutputError, match="which wiclosure did not write there"):
        require_free(out, overwrite=True)


def test_the_folder_that_one_is_in_and_home_are_never_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out"
    with whole_folder(out):
        pass
    monkeypatch.setenv("HOME", str(out))
    with pytest.raises(OutputError, match="where you are, or your home"):
        require_free(out, overwrite=True)
    monkeypatch.setenv("HOME", str(tmp_path))
    (out / "inside").mkdir()
    for place in (out, out / "inside"):
        monkeypatch.chdir(place)
        for name in (out, Path(), Path("..") / "out"):
            if name.exists() and name.resolve() == out.resolve():
                with pytest.raises(OutputError, match="where you are"):
                    require_free(name, overwrite=True)


def test_a_link_is_replaced_and_what_it_points_at_stays(tmp_path: Path) -> None:
    with whole_folder(tmp_path / "real") as scratch:
        (scratch / "a").write_text("x")
    (tmp_path / "link").symlink_to("real")
    with whole_folder(tmp_path / "link", overwrite=True) as scratch:
        (scratch / "b").write_text("y")
    assert (tmp_path / "real" / "a").read_text() == "x"
    assert (tmp_path / "link" / "b").read_text() == "y"
