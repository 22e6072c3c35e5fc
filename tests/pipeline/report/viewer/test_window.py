from __future__ import annotations

import shutil
import socket
import sys
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from wiclosure.errors import ProcessError
from wiclosure.pipeline.report.viewer import Window


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Window]:
    monkeypatch.setenv("HOME", str(tmp_path))
    window = Window(page=True)
    yield window
    window.close()


def test_the_page_talks_to_this_machine_alone(page: Window, tmp_path: Path) -> None:
    assert page.page is not None
    with urllib.request.urlopen(page.page, timeout=20) as answer:
        assert b"rerun" in answer.read().lower()
        policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'self'" in policy
    allowed = {word for word in policy.replace(";", " ").split() if word.startswith("http")}
    assert {word.rpartition(":")[0] for word in allowed} == {"http://127.0.0.1", "http://localhost"}
    assert not list(tmp_path.rglob("*"))  # neither settings nor records of use in the user's folder


def test_it_listens_on_this_machine_only(page: Window) -> None:
    for address in (page.address, page.page or ""):
        port = urllib.parse.urlsplit(address.removeprefix("rerun+")).port
        for host, answers in (("127.0.0.1", True), ("127.0.0.2", False)):  # the second is this machine, too
            with socket.socket() as probe:
                assert (probe.connect_ex((host, port)) == 0) is answers


def test_closing_leaves_no_process(page: Window) -> None:
    port = urllib.parse.urlsplit(page.address.removeprefix("rerun+")).port
    page.close()
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0
    assert not page.open


def test_no_window_without_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ProcessError, match="no screen"):
        Window(page=False)


def test_a_viewer_that_does_not_start_is_said_with_the_way_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    with pytest.raises(ProcessError, match=r"did not start.*--save-rrd"):
        Window(page=True)
