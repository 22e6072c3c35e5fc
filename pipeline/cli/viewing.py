"""`--visualize` and `--save-rrd`: a run in the viewer while it goes, or kept in a file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from glob import escape
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wiclosure.errors import ConfigError, OutputError

if TYPE_CHECKING:
    from wiclosure.pipeline.report.viewer import Window
    from wiclosure.pipeline.stages.viewer import Viewer


@dataclass(frozen=True, slots=True)
class Viewing:
    """Whether and where a run is shown while it goes."""

    visualise: Annotated[
        bool,
        typer.Option(
            "-v",
            "--visualize",
            help="show the run as it goes: in a window, or, without a screen, as a page for a browser on this machine",
        ),
    ] = False
    save_rrd: Annotated[
        Path | None,
        typer.Option(
            "--save-rrd",
            metavar="FILE",
            help="keep what the viewer shows; `rerun FILE` opens it. Several arms have a file each",
            show_default=False,
        ),
    ] = None

    def require_possible(self, *, overwrite: bool, several: bool = False) -> None:
        """Fails before any work.

        Args:
            overwrite: existing files may be replaced.
            several: each of several arms has a file of its own, with its name behind the one that was given.

        Raises:
            ConfigError: the viewer is not installed.
            OutputError: the file exists, or is none of the viewer's.
        """
        if not (self.visualise or self.save_rrd):
            return
        if find_spec("rerun") is None:
            option = "--visualize" if self.visualise else "--save-rrd"
            raise ConfigError(f"{option} needs the viewer rerun, which is not installed; pip install 'wiclosure[viz]'")
        if self.save_rrd is not None:
            if self.save_rrd.suffix != ".rrd":
                raise OutputError(f"--save-rrd {self.save_rrd}: the viewer knows its files by the ending .rrd; add it")
            own = f"{escape(self.save_rrd.stem)}{'-*' if several else ''}.rrd"
            if not overwrite and (taken := next(iter(self.save_rrd.parent.glob(own)), None)):
                raise OutputError(f"{taken} exists already; choose another --save-rrd, or --overwrite")

    @contextmanager
    def viewers(self, folder: Path, scratch: Path, *, quiet: bool) -> Iterator[Viewers]:
        """What opens recordings, and shows where to look.

        Args:
            folder: the result folder as it will be; a file in it is written along.
            scratch: the same until then.
            quiet: say nothing, and do not wait for the user at the end.

        Raises:
            ProcessError: the viewer does not start.
        """
        from wiclosure.pipeline.report.terminal import moves_cursor

        lines = not quiet and not moves_cursor()
        with ExitStack() as stack:
            window = stack.enter_context(_window(wait=not quiet)) if self.visualise else None
            if window is not None and window.page is not None:
                typer.echo(f"the run is shown on {window.page}", err=True)
            file = self.save_rrd
            if file is not None and file.resolve().is_relative_to(folder.resolve()):
                file = scratch / file.resolve().relative_to(folder.resolve())
            yield Viewers(file, window, lines=lines)


@dataclass(frozen=True, eq=False)
class Viewers:
    """What shows each run: a recording in the viewer, and lines where there are no bars."""

    file: Path | None = None
    window: Window | None = None
    lines: bool = False

    @property
    def recording(self) -> bool:
        """Whether runs are shown in the viewer, or kept for it: from this process alone."""
        return self.file is not None or self.window is not None

    @contextmanager
    def of(self, name: str, *, several: bool = False) -> Iterator[Viewer]:
        """A viewer of one run; several runs have a file each, with the run's name.

        Raises:
            OutputError: the file cannot be written.
        """
        from wiclosure.pipeline.report.stage_lines import StageLines
        from wiclosure.pipeline.stages.viewer import NoViewer, Together

        said = StageLines(name if several else "") if self.lines else NoViewer()
        with ExitStack() as stack:
            yield (said if not self.recording else Together([said, self._recording(name, several, stack)]))

    def _recording(self, name: str, several: bool, stack: ExitStack) -> Viewer:
        from wiclosure.pipeline.report.viewer import RerunViewer
        from wiclosure.pipeline.runtime.output import whole_file

        file = self.file
        if file is not None and several:
            file = file.with_stem(f"{file.stem}-{name}")
        scratch = stack.enter_context(whole_file(file)) if file is not None else None
        viewer = RerunViewer(name, file=scratch, address=self.window.address if self.window else None)
        stack.callback(viewer.close)
        return viewer


@contextmanager
def _window(*, wait: bool) -> Iterator[Window]:
    """A window stays when the run is over; a page lives as long as this program, which waits for its user."""
    from wiclosure.pipeline.report.viewer import Window

    window = Window()
    try:
        yield window
        if wait and window.page is not None and sys.stdin.isatty():
            typer.echo("the page stays until you press Enter", err=True)
            sys.stdin.readline()
    finally:
        window.close()
