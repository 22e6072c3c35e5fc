"""One run from scans to a merged map.  This is the pipeline's table of contents."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from wiclosure.backends.graph_result import propagate_to_scans
from wiclosure.backends.merged_map import MergedMap, merge_maps
from wiclosure.display import closure_columns, data_frame, html_table, significant
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.registration import Registration
from wiclosure.interfaces import CandidateFilter
from wiclosure.memory import peak_rss_mb
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.evaluation.evaluate import Findings, evaluate
from wiclosure.pipeline.evaluation.metrics import CostMetrics, Metrics
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.runtime.stopwatch import Stopwatch
from wiclosure.pipeline.stages.odometry import front_ends, remarks
from wiclosure.pipeline.stages.registration_store import RegistrationStore
from wiclosure.pipeline.stages.registrations import Known, RegistrationPool
from wiclosure.pipeline.stages.solve import Solution, solve
from wiclosure.pipeline.stages.viewer import NoViewer, Viewer
from wiclosure.types import KeyframeId, Trajectory
from wiclosure.wiclosure_filter.registry import make_filter

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

logger = logging.getLogger(__name__)

_PLOTTED_POINTS = 100_000


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
    """

    config: Config
    inputs: Inputs
    fronts: dict[str, FrontEndResult]
    solution: Solution
    merged: dict[str, Trajectory]
    merged_map: MergedMap
    metrics: Metrics

    def __repr__(self) -> str:
        name = self.solution.filtered.filter_name
        return f"RunResult({name!r}, {', '.join(self.merged)}, {self.solution.graph!r}, {self.merged_map!r})"

    def _repr_html_(self) -> str:
        """What a notebook shows: the figures of the run, and its remarks."""
        metrics, closures = self.metrics, self.metrics["closures"]
        team_m = metrics["ate_m"]["team"]
        rows = [
            ("robots in one map", " and ".join(self.solution.graph.components[0])),
            ("not connected", " and ".join(self.solution.graph.unconnected)),
            ("candidate pairs", f"{metrics['pairs_kept']:,} of {metrics['pairs_total']:,} kept"),
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


@dataclass(frozen=True, eq=False)
class Prepared:
    """What all runs over the same recordings share: odometry, and registrations done so far.

    Args:
        inputs: the recordings.
        config: of the run.
        fronts: odometry, keyframes, descriptors by robot.
        from_cache: robots whose front end was computed by an earlier invocation.
        known: registrations done so far with these clouds and settings.
        cache: keeps them for later invocations.
        shared: whether another run of this invocation has paid for the front ends already.
        jobs: processes for registrations.
    """

    inputs: Inputs
    config: Config
    fronts: dict[str, FrontEndResult]
    from_cache: tuple[str, ...]
    known: Known = field(default_factory=dict)
    shared: bool = False
    cache: StageCache = field(default_factory=lambda: StageCache(None))
    jobs: int = 1


def candidate_filter(name: str, inputs: Inputs, config: Config) -> CandidateFilter:
    """The filter of that name, with the settings of the run, and ground truth where every robot has it.

    Raises:
        ConfigError: no such filter, or the oracle without ground truth.
    """
    truth = inputs.ground_truth
    return make_filter(name, config.filter, truth if len(truth) == len(inputs.robots) else None)


def prepare(
    inputs: Inputs,
    config: Config,
    *,
    cache: StageCache,
    jobs: int,
    progress: Progress,
    also: Sequence[Config] = (),
    viewer: Viewer | None = None,
) -> Prepared:
    """Every robot's own part: odometry, keyframes, descriptors; see `front_ends`.

    Raises:
        ConfigError: a configuration needs a library that is not installed: said before the work.
    """
    for each in (config, *also):
        Registration(each.registration)
    fronts, from_cache = front_ends(
        inputs.robots, config, cache=cache, jobs=jobs, progress=progress, also=also, viewer=viewer
    )
    return Prepared(inputs, config, fronts, from_cache, cache=cache, jobs=jobs)


def run(prepared: Prepared, chosen: CandidateFilter, *, progress: Progress, viewer: Viewer | None = None) -> RunResult:
    """Filters, matches, registers, optimises, maps and evaluates; a viewer sees every stage."""
    inputs, config, fronts, seen = prepared.inputs, prepared.config, prepared.fronts, viewer or NoViewer()
    seen.fronts(fronts)
    clouds = {KeyframeId(robot, k): cloud for robot, front in fronts.items() for k, cloud in enumerate(front.clouds)}
    registrations = RegistrationPool(config.registration, clouds, prepared.known, prepared.jobs)
    store = RegistrationStore(prepared.cache, fronts, config.registration)
    recalled = store.recall(prepared.known)
    solution = solve(
        fronts, inputs.wireless, chosen, config, registrations=registrations, progress=progress, viewer=seen
    )
    if len(prepared.known) > recalled:
        store.keep(prepared.known)
    merged = {
        robot: propagate_to_scans(front.scans, front.keyframes, solution.graph.trajectories[robot])
        for robot, front in fronts.items()
    }
    took = Stopwatch()
    with took.time("mapping"):
        merged_map = _map(fronts, solution, config)
    found = Findings(
        filtered=solution.filtered,
        closures=solution.closures,
        components=solution.graph.components,
        keyframes={robot: front.keyframes for robot, front in fronts.items()},
        odometry={robot: front.scans for robot, front in fronts.items()},
        merged=merged,
    )
    metrics = evaluate(
        found,
        inputs.ground_truth,
        config.evaluation,
        costs=_costs(prepared, solution, took["mapping"]),
        diagnosis=[*_about_inputs(prepared), *solution.diagnosis],
    )
    for sentence in metrics["diagnosis"]:
        logger.info("%s", sentence)
    result = RunResult(config, inputs, fronts, solution, merged, merged_map, metrics)
    seen.result(result)
    return result


def _costs(prepared: Prepared, solution: Solution, mapping_s: float) -> CostMetrics:
    """What the run took: from raw scans, and without what an earlier run has paid for."""
    paid = [] if prepared.shared else [f for robot, f in prepared.fronts.items() if robot not in prepared.from_cache]
    return {
        "seconds": _stages(prepared.fronts.values(), solution.seconds, mapping_s),
        "seconds_spent": _stages(paid, solution.seconds_spent, mapping_s),
        "bytes_exchanged": solution.bytes_exchanged,
        "peak_rss_mb": peak_rss_mb(),
    }


def _stages(fronts: Collection[FrontEndResult], solving: Mapping[str, float], mapping_s: float) -> dict[str, float]:
    """Seconds of every stage in order, and their sum."""
    seconds = {
        "reading": sum(f.seconds_reading for f in fronts),
        "odometry": sum(f.seconds_odometry for f in fronts),
        "descriptors": sum(f.seconds_descriptors for f in fronts),
        **solving,
        "mapping": mapping_s,
    }
    return seconds | {"total": sum(seconds.values())}


def _map(fronts: dict[str, FrontEndResult], solution: Solution, config: Config) -> MergedMap:
    """The first component's clouds; what is not connected has no place in its frame."""
    first = solution.graph.components[0]
    clouds = (
        (number, pose, cloud)
        for number, (robot, front) in enumerate(fronts.items())
        if robot in first
        for pose, cloud in zip(solution.graph.trajectories[robot].poses, front.clouds, strict=True)
    )
    return merge_maps(clouds, config.map)


def _about_inputs(prepared: Prepared) -> list[str]:
    inputs, fronts = prepared.inputs, prepared.fronts
    sentences = [s for robot in inputs.robots for s in remarks(robot, fronts[robot.robot], prepared.config)]
    if prepared.from_cache:
        sentences.append(
            f"odometry of {', '.join(prepared.from_cache)} was taken from the cache; its seconds are those it took then"
        )
    if len(inputs.robots) == 1 and not prepared.config.revisits.enabled:
        sentences.append("there is one robot only, so there is nothing to merge: its map is that of plain odometry")
    return sentences
