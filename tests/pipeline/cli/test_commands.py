"""How commands are found, and how they end."""

from __future__ import annotations

import contextlib
import errno
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from wiclosure import __version__
from wiclosure.errors import InputError
from wiclosure.pipeline.cli import INTERRUPTED, app
from wiclosure.pipeline.runtime import cache

Call = Callable[..., tuple[int, str, str]]

EXECUTABLE = str(Path(sys.executable).with_name("wiclosure"))  # that of the environment under test


@pytest.fixture(autouse=True)
def same_signals() -> Iterator[None]:
    """`main` listens to signals that end it: only here, not in the tests that follow."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def test_the_commands_are_those_of_the_documentation() -> None:
    assert {command.name for command in app.registered_commands} >= {
        *("run", "compare", "reproduce", "demo", "filter", "optimize", "simulate", "split"),
        *("eval", "info", "dump-config", "cache"),
    }


def test_the_version(wiclosure: Call) -> None:
    assert wiclosure("--version") == (0, f"wiclosure {__version__}\n", "")


def test_nothing_asked_for_is_help(wiclosure: Call) -> None:
    code, out, err = wiclosure()
    assert (code, err) == (0, "")
    assert "wiclosure demo" in out


@pytest.mark.parametrize("words", [["rnu"], ["run"], ["run", "--filtre", "none", "a"], ["run", "a", "-n", "0"]])
def test_wrong_words_are_one_line_that_points_to_help(wiclosure: Call, words: list[str]) -> None:
    code, out, err = wiclosure(*words)
    assert (code, out) == (1, "")
    assert err.startswith("wiclosure: error: ")
    assert err.endswith("(see wiclosure --help)\n")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("raised", "code", "says"),
    [
        (InputError("alpha.bag is\n cut; use --salvage"), 1, "wiclosure: error: alpha.bag is cut; use --salvage\n"),
        (OSError(errno.EACCES, "Permission denied", "a.bag"), 1, "wiclosure: error: a.bag: Permission denied\n"),
        (KeyboardInterrupt(), INTERRUPTED, "interrupted: nothing is written"),
    ],
)
def test_how_commands_end(
    wiclosure: Call, monkeypatch: pytest.MonkeyPatch, raised: BaseException, code: int, says: str
) -> None:
    def fail() -> None:
        raise raised

    monkeypatch.setattr(cache, "default_cache_folder", fail)
    ended, out, err = wiclosure("cache")
    assert (ended, out) == (code, "")
    assert says in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interruption_while_a_module_in_c_loads_is_one(
    wiclosure: Call, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    def fail() -> None:
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            raise ImportError("initialization failed") from None  # as gtsam says it

    monkeypatch.setattr(cache, "default_cache_folder", fail)
    ended, out, err = wiclosure("cache")
    assert (ended, out) == (INTERRUPTED, "")
    assert err.startswith("interrupted: nothing is written")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_before_anything_is_loaded_is_one_line(number: signal.Signals) -> None:
    """As if the signal came while the first module of the command line is loaded."""
    early = (
        "import signal, sys\n"
        "class Interrupts:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'typer':\n"
        f"            signal.raise_signal({int(number)})\n"
        "sys.meta_path.insert(0, Interrupts())\n"
        "from wiclosure.pipeline.cli import main\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", early], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (INTERRUPTED, "")
    assert done.stderr.startswith("interrupted: nothing is written")
    assert done.stderr.count("\n") == 1


def test_a_module_that_cannot_be_loaded_is_no_interruption(wiclosure: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise ImportError("initialization failed")

    monkeypatch.setattr(cache, "default_cache_folder", fail)
    with pytest.raises(ImportError, match="initialization failed"):
        wiclosure("cache")


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("wiclosure optim", "optimize"),
        ("wiclosure run --filter ora", "oracle"),
        ("wiclosure run --config str", "strong"),
    ],
)
def test_a_shell_completes_commands_filters_and_presets(typed: str, offered: str) -> None:
    asked = {"_WICLOSURE_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1)}
    found = subprocess.run(
        [EXECUTABLE],
        env={**os.environ, **asked},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (found.returncode, found.stdout.split()) == (0, [offered])


@pytest.mark.parametrize("words", [("run", "--help"), ("runn",), ("cache",)])
def test_no_color_leaves_no_codes_on_a_terminal(words: tuple[str, ...]) -> None:
    screen, inner = pty.openpty()
    colourless = {**os.environ, "NO_COLOR": "1", "TERM": "xterm-256color"}
    with subprocess.Popen([EXECUTABLE, *words], stdin=inner, stdout=inner, stderr=inner, env=colourless):
        os.close(inner)
        said = b""
        with contextlib.suppress(OSError):  # the other end is closed
            while part := os.read(screen, 65536):
                said += part
    os.close(screen)
    assert said
    assert b"\x1b" not in said


HELP_OF_MANY = """
import contextlib, sys
from wiclosure.pipeline import cli
for command in ("run", "compare", "filter", "simulate", "radio check"):
    sys.argv = ["wiclosure", *command.split(), "--help"]
    with contextlib.suppress(SystemExit):
        cli.main()
"""


@pytest.mark.parametrize("columns", [60, 80, 120])
def test_help_cuts_no_word_in_a_terminal_of_any_width(columns: int) -> None:
    """Each in a process of its own: how wide a terminal is decides how help is written."""
    done = subprocess.run(
        [sys.executable, "-c", HELP_OF_MANY],
        env=os.environ | {"COLUMNS": str(columns)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "\N{HORIZONTAL ELLIPSIS}" not in done.stdout
    assert done.stdout.count("Usage:") == 5
    assert max(map(len, done.stdout.splitlines())) <= columns + 2


def test_help_says_what_exit_codes_mean(wiclosure: Call) -> None:
    said = " ".join(wiclosure("--help")[1].split())
    assert f"0 done, 1 refused or failed (one line on standard error says why), {INTERRUPTED} interrupted" in said
