"""What a run finds, from candidates to the merged map."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.backends.odometry_jump import OdometryJump
from wiclosure.display import closure_columns, data_frame, html_table, listed, significant
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.place_recognition.matching import MatchResult
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.evaluation.metrics import Metrics
from wiclosure.pipeline.grounding.grounding import Grounding
from wiclosure.types import Closure, FilterResult, Stage, Trajectory, survivors

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_PLOTTED_POINTS = 100_000
_FIGURES = re.compile(r"-?\d[\d.,^]*")


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
        diagnosis: sentences for the user: why there are few or no closures, or why the map may be wrong.
        contradictions: those on robots of which radio and closures, or clocks, tell differently.
        doubts: those on robots of which two sets of closures contradict each other, one of them accepted, or whose
            scans fit as well otherwise, and on odometry that may jump.
        open_jumps: steps of odometry that some of the doubts are of.
        without_radio: robots that measured each other and went on as if they had not.
    """

    filtered: FilterResult
    matched: tuple[MatchResult, ...]
    closures: tuple[Closure, ...]
    graph: GraphResult
    seconds: dict[str, float]
    seconds_spent: dict[str, float]
    bytes_exchanged: int
    diagnosis: tuple[str, ...]
    contradictions: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    open_jumps: tuple[OdometryJump, ...] = ()
    without_radio: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class RunResult:
    """Everything that a run found; `wiclosure.pipeline.stages.run_folder` writes it.

    In a notebook it shows its figures; `plot()` draws the map, `to_dataframe()` lists the closures.  What it is made of
    can be walked: `merged["beta"]` is a trajectory, `solution.filtered` what the filter kept, `solution.graph` the
    estimate, each of which shows, draws and lists itself likewise.

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

    def _repr_html_(self) -> str:
        """What a notebook shows: the figures of the run, and its remarks."""
        metrics, closures = self.metrics, self.metrics["closures"]
        team_m, pairs = metrics["ate_m"]["team"], metrics["pairs_total"]
        rows = [
            ("robots in one map", listed(self.solution.graph.components[0])),
            ("doubt", "the map may be wrong: see the remarks" if self.solution.doubts else ""),
            ("not connected", listed(self.solution.graph.unconnected)),
            ("candidate pairs", f"{metrics['pairs_kept']:,} of {pairs:,} kept" if pairs else ""),
            ("closures", f"{closures['accepted']} of {closures['proposed']} accepted"),
            ("team ATE", "" if team_m is None else f"{significant(team_m)} m"),
            ("seconds", f"{metrics['seconds']['total']:.1f}"),
            *(("remark", sentence) for sentence in metrics["diagnosis"]),
        ]
        return html_table(f"run with the filter {metrics['filter']}", [row for row in rows if row[1]])

    def plot(self) -> Figure:
        """The merged map with paths and accepted closures from above, as a matplotlib figure."""
        rng = np.random.default_rng(0)
        some = rng.permutation(len(self.merged_map))[:_PLOTTED_POINTS]
        return self.solution.graph.plot(self.merged_map.points[some].astype(float))

    def to_dataframe(self) -> pd.DataFrame:
        """Every proposed closure, one row each, with its decision and reason.

        Raises:
            ConfigError: pandas is not installed.
        """
        return data_frame(closure_columns(self.solution.closures))


def own_loops(closures: Sequence[Closure]) -> tuple[str, ...]:
    """A sentence for each robot that came back to where it had been."""
    own: dict[str, list[Closure]] = {}
    for closure in closures:
        if closure.query.robot == closure.match.robot:
            own.setdefault(closure.query.robot, []).append(closure)
    return tuple(
        f"{robot}: of {len(found)} proposed loops within its own path {len(survivors(found, Stage.REGISTRATION))} were"
        f" registered and {len(survivors(found, Stage.ESTIMATE))} accepted"
        for robot, found in own.items()
    )


def nothing_to_merge(fronts: Mapping[str, FrontEndResult], closures: Sequence[Closure]) -> tuple[str, ...]:
    """A sentence where there is one robot that never came back."""
    if len(fronts) > 1 or survivors(closures, Stage.ESTIMATE):
        return ()
    return (
        "there is one robot only and no loop within its path, so there is nothing to merge: its map is that of plain"
        " odometry",
    )


def nothing_left(
    filtered: FilterResult, matched: Sequence[MatchResult], closures: Sequence[Closure]
) -> tuple[str, ...]:
    """Where the candidates were lost, said when nothing reached the graph."""
    registered, checked, estimated = (
        len(survivors(closures, stage)) for stage in (Stage.REGISTRATION, Stage.RADIO_CHECK, Stage.ESTIMATE)
    )
    if estimated or not filtered.pairs:
        return ()
    reasons = [closure.reason for closure in closures if closure.rejected_at is not None]
    kinds = Counter(_FIGURES.sub("", reason) for reason in reasons)
    usual = next((r for r in reasons if _FIGURES.sub("", r) == kinds.most_common(1)[0][0]), "")
    often = f"; for example: {usual}" if usual else ""
    return (
        f"no closure was accepted: of {filtered.pairs_total} pairs the filter kept {filtered.pairs_kept}, scan context"
        f" compared {sum(m.pairs_compared for m in matched)} and proposed {len(closures)}, registration accepted"
        f" {registered}, of which the radio check left {checked}{often}",
    )
