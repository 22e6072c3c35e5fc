"""Shows a run in Rerun, or keeps it in a file, stage after stage."""

from __future__ import annotations

import logging
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import rerun as rr

from wiclosure.frontends.front_end import Followed
from wiclosure.frontends.front_end_result import FrontEndResult
from wiclosure.pipeline.report.viewer import merged_world, own_frames
from wiclosure.pipeline.report.viewer.blueprint import blueprint
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import Closure, FilterResult

logger = logging.getLogger(__name__)

_FLUSH_S = 10.0


class RerunViewer:
    """One recording, kept in a file, shown in a viewer, or both.

    The file holds the same whenever the same run is kept; a viewer also sees scans while odometry follows them.

    Args:
        name: of the recording, as the viewer lists it.
        file: `.rrd` to write.
        address: of a viewer.
    """

    def __init__(self, name: str, *, file: Path | None = None, address: str | None = None) -> None:
        recording = str(uuid.uuid4())
        self._live = None if address is None else _Stream(name, recording, rr.GrpcSink(address))
        self._streams = [] if self._live is None else [self._live]
        if file is not None:
            self._streams.append(_Stream(name, recording, rr.FileSink(file)))
        self._frames = own_frames.OwnFrames({}, {})
        self._numbers: dict[str, int] = {}

    @property
    def follows_scans(self) -> bool:
        """Where somebody looks."""
        return self._live is not None

    def scan(self, robot: str, followed: Followed) -> None:
        """The scan in its robot's own frame."""
        number = self._numbers.setdefault(robot, len(self._numbers))
        if self._live is not None:
            self._live.show(lambda recording: own_frames.show_scan(recording, robot, number, followed))

    def fronts(self, fronts: Mapping[str, FrontEndResult]) -> None:
        """Odometry and keyframes, one robot beside the other."""
        self._frames = own_frames.OwnFrames.of(fronts)
        self._stage(lambda recording: own_frames.show_fronts(recording, fronts, self._frames))

    def candidates(self, filtered: FilterResult) -> None:
        """Lines across the own frames."""
        self._stage(lambda recording: own_frames.show_candidates(recording, filtered.pairs, self._frames))

    def closures(self, closures: Sequence[Closure]) -> None:
        """Lines across the own frames, coloured by what is known of them."""
        self._stage(lambda recording: own_frames.show_closures(recording, closures, self._frames))

    def result(self, result: RunResult) -> None:
        """The merged world; after that nothing follows."""
        self._stage(lambda recording: merged_world.show_result(recording, result), finished=True)

    def close(self) -> None:
        """Sends what waits, for some seconds at most."""
        for stream in self._streams:
            stream.close()

    def _stage(self, show: Callable[[rr.RecordingStream], list[str]], *, finished: bool = False) -> None:
        for stream in self._streams:
            stream.stage(show, finished=finished)


class _Stream:
    """A recording and where it goes.  What goes wrong in it is told once; the run goes on without."""

    def __init__(self, name: str, recording: str, sink: rr.GrpcSink | rr.FileSink) -> None:
        self._recording = rr.RecordingStream("wiclosure", recording_id=recording)
        self._recording.set_sinks(sink)
        self._recording.send_recording_name(name)
        self._lasting: set[str] = set()
        self._failed = False

    def stage(self, show: Callable[[rr.RecordingStream], list[str]], *, finished: bool) -> None:
        """Shows a stage, and lays the view out for the entities that it brought."""

        def show_with_layout(recording: rr.RecordingStream) -> None:
            self._lasting.update(show(recording))
            recording.send_blueprint(blueprint(sorted(self._lasting), finished=finished))

        self.show(show_with_layout)

    def show(self, show: Callable[[rr.RecordingStream], object]) -> None:
        if self._failed:
            return
        try:
            show(self._recording)
        except Exception as error:  # whatever a viewer fails at must not end hours of work
            self._failed = True
            logger.warning("the viewer stopped (%s: %s); the run goes on without it", type(error).__name__, error)

    def close(self) -> None:
        self.show(lambda recording: recording.flush(timeout_sec=_FLUSH_S))
        self._recording.disconnect()
