from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from wiclosure.scratch import remove_abandoned, temporary_folder, unfinished_file, unfinished_folder

BEGIN = """
import sys, time
from pathlib import Path
from wiclosure.scratch import REPLACED, unfinished_file, unfinished_folder
here = Path(sys.argv[1])
(unfinished_folder(here) / "part").write_text("x")
unfinished_file(here)
(unfinished_folder(here, REPLACED) / "result").mkdir()
print("begun", flush=True)
time.sleep(60)
"""


@pytest.fixture
def begun(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that has written three things there and is still at work."""
    with subprocess.Popen([sys.executable, "-c", BEGIN, tmp_path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        yield process
        process.kill()


def test_what_a_process_leaves_is_removed_when_it_is_gone_and_not_before(
    tmp_path: Path, begun: subprocess.Popen[str]
) -> None:
    mine = unfinished_folder(tmp_path)
    assert len(list(tmp_path.iterdir())) == 4
    begun.send_signal(signal.SIGKILL)
    begun.wait()
    remove_abandoned(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {mine.name, "result"}  # which nothing had replaced
    assert mine.stat().st_mode & 0o777 == 0o700


def test_another_process_of_the_same_number_is_not_its_owner(tmp_path: Path) -> None:
    mine = unfinished_folder(tmp_path)
    head, pid, start, rest = mine.name.rsplit("-", 3)
    assert pid == str(os.getpid())
    other = tmp_path / f"{head}-{pid}-{int(start) - 1}-{rest}"
    other.mkdir()
    remove_abandoned(tmp_path)
    assert mine.exists()
    assert not other.exists()


def test_links_and_what_others_made_stay(tmp_path: Path) -> None:
    mine = unfinished_folder(tmp_path)
    head, _, _, rest = mine.name.rsplit("-", 3)
    target = tmp_path / "target"
    target.mkdir()
    (target / "precious").write_text("x")
    gone = f"{head}-{2**22 + 1}-1-{rest}"  # no process has that number
    (tmp_path / gone).symlink_to(target)
    elsewhere = tmp_path / gone.replace(head.split("-")[1], "0" * 8)  # of another machine
    elsewhere.mkdir()
    for name in (".out.1234.unfinished", "unfinished", ".wiclosure-x.unfinished"):
        (tmp_path / name).mkdir()
    before = sorted(tmp_path.iterdir())
    remove_abandoned(tmp_path)
    assert sorted(tmp_path.iterdir()) == before
    assert (target / "precious").exists()
    inside = tmp_path / gone.replace("-1-", "-2-")
    inside.mkdir()
    (inside / "link").symlink_to(target)
    remove_abandoned(tmp_path)
    assert not inside.exists()
    assert (target / "precious").exists()


def test_temporary_folders_vanish(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with temporary_folder() as folder:
        (folder / "a").write_text("x")
    assert list(tmp_path.iterdir()) == []


def test_files_are_for_their_owner_alone(tmp_path: Path) -> None:
    assert unfinished_file(tmp_path).stat().st_mode & 0o777 == 0o600
    remove_abandoned(tmp_path / "absent")
