from __future__ import annotations

import json
import logging
from datetime import datetime
from pathlib import Path

import pytest

from wiclosure.errors import printable
from wiclosure.pipeline.runtime.log import json_log, warnings_on_terminal

OURS = logging.getLogger("wiclosure.backends.consistency.pcm")


def test_each_line_is_one_record_of_the_package(tmp_path: Path) -> None:
    OURS.info("before")
    with json_log(tmp_path / "log.jsonl"):
        OURS.info("%d closures\nin two lines", 3)
        OURS.warning("räumlich")
        OURS.debug("too fine")
        logging.getLogger("another").error("not ours")
    OURS.info("after")
    records = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text(encoding="utf-8").splitlines()]
    assert [(r["level"], r["module"], r["message"]) for r in records] == [
        ("info", "backends.consistency.pcm", "3 closures\nin two lines"),
        ("warning", "backends.consistency.pcm", "räumlich"),
    ]
    assert all(datetime.fromisoformat(r["time"]).tzinfo is not None for r in records)


def test_the_logger_is_left_as_it_was(tmp_path: Path) -> None:
    logger = logging.getLogger("wiclosure")
    before = (logger.level, list(logger.handlers))
    with pytest.raises(RuntimeError), json_log(tmp_path / "log.jsonl"), warnings_on_terminal():
        raise RuntimeError
    assert (logger.level, logger.handlers) == before


def test_warnings_are_one_line_on_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    with warnings_on_terminal():
        OURS.info("fine")
        OURS.warning("%s was repaired", "alpha.bag")
    assert capsys.readouterr() == ("", "wiclosure: warning: alpha.bag was repaired\n")


def test_a_warning_that_repeats_is_shown_once(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with warnings_on_terminal(), json_log(tmp_path / "log.jsonl"):
        for name in ("alpha", "alpha", "beta"):
            OURS.warning("%s has no metadata", name)
    assert capsys.readouterr().err.count("wiclosure: warning:") == 2
    assert len((tmp_path / "log.jsonl").read_text().splitlines()) == 3


def test_what_terminals_obey_is_escaped() -> None:
    assert printable("robot a\nb \x1b[2J\u202e done") == "robot a b \\x1b[2J\\u202e done"


def test_a_full_disk_under_the_log_is_an_error_and_no_traceback_on_the_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(OSError, match="No space left"), json_log(Path("/dev/full")):
        logging.getLogger("wiclosure.test").info("a line")
    assert capsys.readouterr().err == ""
