from __future__ import annotations

import io
import sys

import pytest

from wiclosure.pipeline.report.progress_bars import BarProgress


class Terminal(io.StringIO):
    """Standard error that says that it is a terminal."""

    def isatty(self) -> bool:
        return True


def on_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Called in the test itself: pytest exchanges standard error between set-up and test."""
    screen = Terminal()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setenv("COLUMNS", "140")
    monkeypatch.setenv("TERM", "xterm")
    return screen


def test_a_bar_counts_the_items_that_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = on_terminal(monkeypatch)
    assert list(BarProgress().track(range(7), "reading alpha", 7)) == list(range(7))
    assert "reading alpha" in screen.getvalue()
    assert "7/7" in screen.getvalue()


def test_one_bar_per_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = on_terminal(monkeypatch)
    with BarProgress().together({"alpha": 4, "beta": 5}, "odometry") as show:
        show("alpha", 4)
        show("beta", 2)
    for text in ("odometry alpha", "4/4", "odometry beta", "2/5"):
        assert text in screen.getvalue()


def test_nothing_is_shown_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(BarProgress().track(range(3), "reading", 3)) == [0, 1, 2]
    assert capsys.readouterr() == ("", "")
