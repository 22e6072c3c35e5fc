"""The viewer's own process: a window where there is a screen, else a page for a browser on this machine."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from wiclosure.errors import ProcessError
from wiclosure.pipeline.report.viewer.local_page import LocalPage
from wiclosure.scratch import unfinished_folder

_START_S = 20.0
_MEMORY = "1GiB"  # what it holds for a browser that comes late


class Window:
    """Listens on this machine only, and tells nobody about itself.

    Args:
        page: serve a page instead of opening a window; None: where there is no screen.

    Raises:
        ProcessError: the viewer does not start, or there is no screen for its window.
    """

    def __init__(self, *, page: bool | None = None) -> None:
        screen = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
        if page is False and not screen:
            raise ProcessError("there is no screen for a window of the viewer; DISPLAY and WAYLAND_DISPLAY are not set")
        self._page = page if page is not None else not screen
        self._settings = unfinished_folder(Path(tempfile.gettempdir()))
        self._port, self._web_port = _free_port(), _free_port()
        self._process = self._start()
        self._local = LocalPage(self._web_port, self._port) if self._page else None

    @property
    def address(self) -> str:
        """Where a recording is to be sent."""
        return f"rerun+http://127.0.0.1:{self._port}/proxy"

    @property
    def page(self) -> str | None:
        """What to open in a browser; None where a window shows it."""
        if self._local is None:
            return None
        return f"http://127.0.0.1:{self._local.port}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{self._port}%2Fproxy"

    @property
    def open(self) -> bool:
        """Whether it still runs."""
        return self._process.poll() is None

    def close(self) -> None:
        """Ends a page; a window stays until its user closes it."""
        if self._local is not None:
            self._local.close()
            _end(self._process)
        shutil.rmtree(self._settings, ignore_errors=True)

    def _start(self) -> subprocess.Popen[bytes]:
        # Its settings lie in a folder of this run alone, where its analytics are off; the user's own stay as they are.
        private = {"XDG_CONFIG_HOME": str(self._settings), "XDG_DATA_HOME": str(self._settings)}
        environment = {**os.environ, **private}
        program = [sys.executable, "-m", "rerun"]
        here = ["--bind", "127.0.0.1", "--port", str(self._port), "--server-memory-limit", _MEMORY]
        shown = ["--serve-web", "--web-viewer-port", str(self._web_port)] if self._page else ["--hide-welcome-screen"]
        log = self._settings / "log.txt"
        with log.open("wb") as said:
            subprocess.run([*program, "analytics", "disable"], check=False, env=environment, stdout=said, stderr=said)
            process = subprocess.Popen(
                [*program, *here, *shown],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=said,
                start_new_session=True,
            )
        awaited = [self._port, self._web_port] if self._page else [self._port]  # one comes up after the other
        if not all(_listens(port, process) for port in awaited):
            _end(process)
            words = log.read_text(errors="replace").split()
            shutil.rmtree(self._settings, ignore_errors=True)
            raise ProcessError(
                f"the viewer did not start: {' '.join(words[-40:])}; leave out --visualize, or use"
                " --save-rrd FILE and open it elsewhere with: rerun FILE"
            )
        return process


def _end(process: subprocess.Popen[bytes]) -> None:
    """The launcher, and the viewer that it launched."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGTERM)
    process.wait(timeout=_START_S)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _listens(port: int, process: subprocess.Popen[bytes]) -> bool:
    began = time.monotonic()
    while time.monotonic() - began < _START_S and process.poll() is None:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return True
        time.sleep(0.05)
    return False
