from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest

from wiclosure.errors import OutputError
from wiclosure.pipeline.cli.options import Result
from wiclosure.pipeline.cli.result_folder import result_folder


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_named_folder_holds_what_was_written_and_the_log(capsys: pytest.CaptureFixture[str]) -> None:
    with result_folder(Result(Path("out"))) as (folder, scratch):
        assert not folder.exists()
        (scratch / "map.ply").touch()
        logging.getLogger("wiclosure.test").warning("slow")
    assert {"map.ply", "log.jsonl"} <= {path.name for path in Path("out").iterdir()}
    assert json.loads(Path("out/log.jsonl").read_text())["message"] == "slow"
    assert capsys.readouterr().err == "wiclosure: warning: slow\n"
    assert not Path("latest").exists()


def test_latest_points_to_a_folder_that_is_named_by_the_time() -> None:
    with result_folder(Result()) as (folder, _):
        pass
    assert folder.parent == Path("results")
    assert Path("results/latest").resolve() == folder.resolve()


def test_what_is_read_is_not_replaced() -> None:
    Path("out").mkdir()
    for word in ("alpha=out/a.bag", "out"):
        with pytest.raises(OutputError, match="which is read"), result_folder(Result(Path("out"), True), [word]):
            pass
    assert Path("out").is_dir()


def test_a_command_that_fails_leaves_nothing() -> None:
    with pytest.raises(RuntimeError), result_folder(Result()):
        raise RuntimeError
    assert list(Path("results").iterdir()) == []
