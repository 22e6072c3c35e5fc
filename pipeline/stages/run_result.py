"""What a run finds, from candidates to the merged map."""

from __future__ import annotations

from dataclasses import dataclass, field

from wiclosure.backends.graph_result import GraphResult
from wiclosure.backends.merged_map import MergedMap
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.matching import MatchResult
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.evaluation.metrics import Metrics
from wiclosure.pipeline.grounding.grounding import Grounding
from wiclosure.types import Closure, FilterResult, Trajectory


@dataclass(frozen=True, eq=False)
class Solution:
    """What one filter made of the robots' odometry.

    Args:
        filtered: pairs kept by the filter, alignments, its diagnosis.
        matched: what scan context proposed of them, one entry per robot pair.
        closures: every proposed closure with its final decision and reason; how many survived a stage is a count.
        graph: trajectories in one world frame.
        seconds: time per stage, as if nothing had been computed before; of registrations side by side, their sum.
        seconds_spent: wall time really spent, registrations that other arms had done left out.
        bytes_exchanged: what the robots would have sent each other.
        diagnosis: sentences for the user: why there are few or no closures.
    """

    filtered: FilterResult
    matched: tuple[MatchResult, ...]
    closures: tuple[Closure, ...]
    graph: GraphResult
    seconds: dict[str, float]
    seconds_spent: dict[str, float]
    bytes_exchanged: int
    diagnosis: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class RunResult:
    """Everything that a run found; `wiclosure.pipeline.stages.run_folder` writes it.

    Args:
        config: what it ran with.
        inputs: what it read.
        fronts: odometry, keyframes, descriptors by robot.
        solution: candidates, closures, graph.
        merged: pose of every scan at its own stamp by robot, in the world of its component.
        merged_map: the keyframes' clouds of the first robot's component in one frame.
        metrics: all figures.
        grounding: what is known of the Earth; `fronts` are its own.
    """

    config: Config
    inputs: Inputs
    fronts: dict[str, FrontEndResult]
    solution: Solution
    merged: dict[str, Trajectory]
    merged_map: MergedMap
    metrics: Metrics
    grounding: Grounding = field(default_factory=Grounding)

    def __repr__(self) -> str:
        name = self.solution.filtered.filter_name
        return f"RunResult({name!r}, {', '.join(self.merged)}, {self.solution.graph!r}, {self.merged_map!r})"
