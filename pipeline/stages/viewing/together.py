"""Several viewers of one run, as one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from wiclosure.frontends.front_end import Followed
from wiclosure.frontends.front_end_result import FrontEndResult
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.pipeline.stages.viewing.viewer import Viewer
from wiclosure.types import Closure, FilterResult


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
