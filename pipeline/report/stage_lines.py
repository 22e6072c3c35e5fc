"""A run in lines: what each stage found, for terminals without bars, pipes and logs."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence

from wiclosure.display import listed
from wiclosure.frontends.front_end import Followed
from wiclosure.frontends.front_end_result import FrontEndResult
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import Closure, FilterResult


class StageLines:
    """Says a line for each stage on standard error."""

    follows_scans = False

    def __init__(self, name: str = "") -> None:
        self._begins = f"{name}: " if name else ""
        self._last = ""

    def scan(self, robot: str, followed: Followed) -> None:
        """Says nothing: there are too many."""

    def fronts(self, fronts: Mapping[str, FrontEndResult]) -> None:
        """A line for each robot."""
        for robot, front in fronts.items():
            length_m = front.odometry.distance[-1]
            keyframes = f"{len(front.keyframes):,} keyframe{'' if len(front.keyframes) == 1 else 's'}"
            self._say(
                f"odometry of {robot}: {len(front.odometry):,} of {front.counts.scans:,} scans, {keyframes},"
                f" {length_m:,.1f} m"
            )

    def candidates(self, filtered: FilterResult) -> None:
        """How many pairs are kept; of a lone robot there are none."""
        kept, total = filtered.pairs_kept, filtered.pairs_total
        if total:
            self._say(f"filter {filtered.filter_name}: {kept:,} of {total:,} pairs kept in {filtered.seconds:.1f} s")

    def closures(self, closures: Sequence[Closure]) -> None:
        """How many are proposed, or left after registration and radio check."""
        if not any(c.measured is not None or c.rejected_at is not None for c in closures):
            self._say(f"matching: {len(closures):,} closures proposed")
            return
        left = sum(c.rejected_at is None for c in closures)
        self._say(f"registration and radio check: {left:,} of {len(closures):,} closures left")

    def result(self, result: RunResult) -> None:
        """What is in the map."""
        graph = result.solution.graph
        joined = listed(graph.components[0])
        apart = f", not connected: {', '.join(graph.unconnected)}" if graph.unconnected else ""
        sure = ", which may be wrong" if result.solution.doubts else ""
        self._say(f"estimate: {len(graph.accepted):,} closures accepted; one map of {joined}{sure}{apart}")
        self._say(f"map: {len(result.merged_map):,} points")

    def _say(self, line: str) -> None:
        if line == self._last:  # of no closures there is nothing to register
            return
        self._last = line
        print(f"{self._begins}{line}", file=sys.stderr, flush=True)  # noqa: T201
