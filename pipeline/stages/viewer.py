"""What a run shows of itself while it goes; the pipeline calls it at every stage, whether somebody looks or not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from wiclosure.frontends.front_end import Followed
from wiclosure.frontends.front_end_result import FrontEndResult
from wiclosure.types import Closure, FilterResult

if TYPE_CHECKING:
    from wiclosure.pipeline.stages.run_result import RunResult


class Viewer(Protocol):
    """Takes what each stage found.  It changes nothing of it, and raises nothing: a viewer never harms a run."""

    @property
    def follows_scans(self) -> bool:
        """Whether `scan` is wanted while odometry goes on."""
        ...

    def scan(self, robot: str, followed: Followed) -> None:
        """The scan that a robot's odometry took last; some of them, as time allows."""
        ...

    def fronts(self, fronts: Mapping[str, FrontEndResult]) -> None:
        """Odometry, keyframes and clouds of every robot."""
        ...

    def candidates(self, filtered: FilterResult) -> None:
        """What the filter keeps; again where it is asked again with less of the log."""
        ...

    def closures(self, closures: Sequence[Closure]) -> None:
        """Proposed closures, and again when registration and radio check have decided on them."""
        ...

    def result(self, result: RunResult) -> None:
        """Everything, at the end."""
        ...


class NoViewer:
    """Nobody looks."""

    follows_scans = False

    def scan(self, robot: str, followed: Followed) -> None:
        """Shows nothing."""

    def fronts(self, fronts: Mapping[str, FrontEndResult]) -> None:
        """Shows nothing."""

    def candidates(self, filtered: FilterResult) -> None:
        """Shows nothing."""

    def closures(self, closures: Sequence[Closure]) -> None:
        """Shows nothing."""

    def result(self, result: RunResult) -> None:
        """Shows nothing."""


class Together:
    """Several viewers of one run."""

    def __init__(self, viewers: Sequence[Viewer]) -> None:
        self._viewers = viewers

    @property
    def follows_scans(self) -> bool:
        """Whether one of them does."""
        return any(viewer.follows_scans for viewer in self._viewers)

    def scan(self, robot: str, followed: Followed) -> None:
        """To all of them."""
        for viewer in self._viewers:
            viewer.scan(robot, followed)

    def fronts(self, fronts: Mapping[str, FrontEndResult]) -> None:
        """To all of them."""
        for viewer in self._viewers:
            viewer.fronts(fronts)

    def candidates(self, filtered: FilterResult) -> None:
        """To all of them."""
        for viewer in self._viewers:
            viewer.candidates(filtered)

    def closures(self, closures: Sequence[Closure]) -> None:
        """To all of them."""
        for viewer in self._viewers:
            viewer.closures(closures)

    def result(self, result: RunResult) -> None:
        """To all of them."""
        for viewer in self._viewers:
            viewer.result(result)
