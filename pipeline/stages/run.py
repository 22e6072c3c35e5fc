"""One run from scans to a merged map.  This is the pipeline's table of contents."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import repeat

import numpy as np

from wiclosure.backends.estimate.graph_result import propagate_to_scans
from wiclosure.backends.merged.merged_map import MergedMap, merge_maps
from wiclosure.frontends.front_end import FrontEndResult
from wiclosure.frontends.moving_objects import standing
from wiclosure.frontends.registration.registration import Registration
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.interfaces import CandidateFilter
from wiclosure.memory import peak_rss_mb
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.evaluation.evaluate import Findings, evaluate
from wiclosure.pipeline.evaluation.metrics import CostMetrics
from wiclosure.pipeline.grounding.grounding import Grounding, earth_metrics, grounded
from wiclosure.pipeline.radio.part_read import without_later
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.processes import local_workers
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.runtime.stopwatch import Stopwatch
from wiclosure.pipeline.stages.odometry import front_ends, remarks
from wiclosure.pipeline.stages.registration_store import RegistrationStore
from wiclosure.pipeline.stages.registrations import KnownRegistrations, RegistrationPool
from wiclosure.pipeline.stages.run_result import RunResult, Solution
from wiclosure.pipeline.stages.solve import solve
from wiclosure.pipeline.stages.stored_clouds import StoredClouds
from wiclosure.pipeline.stages.viewer import NoViewer, Viewer
from wiclosure.types import BoolArray, Float32Array, FloatArray, KeyframeId, Trajectory
from wiclosure.wiclosure_filter.registry import make_filter
from wiclosure.workers import Workers

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Prepared:
    """What all runs over the same recordings share: odometry, and registrations done so far.

    Args:
        inputs: the recordings.
        config: of the run.
        grounding: odometry, keyframes, descriptors by robot, and what is known of the Earth.
        from_cache: robots whose front end was computed by an earlier invocation.
        known: registrations done so far with these clouds and settings.
        cache: keeps them for later invocations.
        shared: whether another run of this invocation has paid for the front ends already.
        jobs: processes for registrations.
        cluster: does the work in their place.
    """

    inputs: Inputs
    config: Config
    grounding: Grounding
    from_cache: tuple[str, ...]
    known: KnownRegistrations = field(default_factory=dict)
    shared: bool = False
    cache: StageCache = field(default_factory=lambda: StageCache(None))
    jobs: int = 1
    cluster: Workers | None = None

    @property
    def fronts(self) -> dict[str, FrontEndResult]:
        """Odometry, keyframes, descriptors by robot."""
        return self.grounding.fronts


def candidate_filter(name: str, inputs: Inputs, config: Config, workers: Workers | None = None) -> CandidateFilter:
    """The filter of that name, with the settings of the run, and ground truth where every robot has it.

    Raises:
        ConfigError: no such filter, or the oracle without ground truth.
    """
    truth = inputs.ground_truth
    return make_filter(name, config.filter, truth if len(truth) == len(inputs.robots) else None, workers)


def prepare(
    inputs: Inputs,
    config: Config,
    *,
    cache: StageCache,
    jobs: int,
    progress: Progress,
    also: Sequence[Config] = (),
    viewer: Viewer | None = None,
    cluster: Workers | None = None,
) -> Prepared:
    """Every robot's own part: odometry, keyframes, descriptors; see `front_ends`.

    Raises:
        ConfigError: a configuration needs a library that is not installed: said before the work.
    """
    for each in (config, *also):
        Registration(each.registration)
    fronts, from_cache = front_ends(
        inputs.robots, config, cache=cache, jobs=jobs, progress=progress, also=also, viewer=viewer, workers=cluster
    )
    if inputs.limit is not None:
        read_in_part = {name: front for name, front in fronts.items() if front.counts.scans >= inputs.limit}
        ends_ns = {name: int(front.scans.stamps_ns[-1]) for name, front in read_in_part.items()}
        inputs = replace(inputs, wireless=without_later(inputs.wireless, ends_ns, inputs.limit))
    grounding = grounded(fronts, inputs, config.earth)
    return Prepared(inputs, config, grounding, from_cache, cache=cache, jobs=jobs, cluster=cluster)


def run_stages(
    prepared: Prepared, chosen: CandidateFilter, *, progress: Progress, viewer: Viewer | None = None
) -> RunResult:
    """Filters, matches, registers, optimises, maps and evaluates; a viewer sees every stage."""
    inputs, config, fronts, seen = prepared.inputs, prepared.config, prepared.fronts, viewer or NoViewer()
    seen.fronts(fronts)
    clouds = {KeyframeId(robot, k): cloud for robot, front in fronts.items() for k, cloud in enumerate(front.clouds)}
    workers = prepared.cluster or local_workers(prepared.jobs)
    stored = (
        {robot: StoredClouds.of(robot, front.clouds, prepared.cache) for robot, front in fronts.items()}
        if workers.remote
        else {}
    )
    registrations = RegistrationPool(config.registration, clouds, prepared.known, workers, stored)
    store = RegistrationStore(prepared.cache, fronts, config.registration)
    recalled = store.recall(prepared.known)
    solution = solve(
        fronts, inputs.wireless, chosen, config, registrations=registrations, progress=progress, viewer=seen,
        earth=prepared.grounding.earth,
    )  # fmt: skip
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
        diagnosis=[*solution.diagnosis, *_about_inputs(prepared)],
    )
    metrics["doubts"] = list(solution.doubts)
    if prepared.grounding.earth:
        metrics["earth"] = earth_metrics(prepared.grounding, solution.graph)
    for sentence in metrics["diagnosis"]:
        logger.info("%s", sentence)
    result = RunResult(config, inputs, fronts, solution, merged, merged_map, metrics, prepared.grounding)
    seen.result(result)
    return result


def _costs(prepared: Prepared, solution: Solution, mapping_s: float) -> CostMetrics:
    """What the run took: from raw scans, and without what an earlier run has paid for."""
    paid = [] if prepared.shared else [f for robot, f in prepared.fronts.items() if robot not in prepared.from_cache]
    gravity_s = prepared.grounding.seconds
    spent = {"gravity": 0.0 if prepared.shared else gravity_s} | solution.seconds_spent
    costs: CostMetrics = {
        "seconds": _stages(prepared.fronts.values(), {"gravity": gravity_s} | solution.seconds, mapping_s),
        "seconds_spent": _stages(paid, spent, mapping_s),
        "bytes_exchanged": solution.bytes_exchanged,
        "peak_rss_mb": peak_rss_mb(),
    }
    if prepared.cluster is not None and (work := prepared.cluster.costs) is not None:
        costs["workers"] = {
            "used": len(work.workers),
            "retries": work.retries,
            "bytes_moved": work.bytes_moved,
        }
    return costs


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
    coloured = any(fronts[robot].intensities is not None for robot in first)
    clouds = (
        (number, pose, cloud)
        for number, (robot, front) in enumerate(fronts.items())
        if robot in first
        for pose, cloud in _placed(front, solution.graph.trajectories[robot], config, coloured)
    )
    return merge_maps(clouds, config.map)


def _placed(
    front: FrontEndResult, merged: Trajectory, config: Config, coloured: bool
) -> Iterator[tuple[FloatArray, Float32Array]]:
    """Pose and cloud of a robot's keyframes, without what moves where the settings say so.

    Where some robot has intensities, all clouds have a fourth column of them, NaN where they are not known.
    """
    masks: Iterator[BoolArray | None] = repeat(None)
    if not config.map.moving_objects:
        voxel_m = (config.odometry.voxel_size_m or voxel_size_m(front.clouds[0])) / 2  # what keyframes are thinned to
        masks = standing(front.clouds, merged.poses, voxel_m)
    unknown = (np.full(len(cloud), np.nan, np.float16) for cloud in front.clouds)
    for pose, points, intensity in zip(merged.poses, front.clouds, front.intensities or unknown, strict=True):
        cloud, mask = np.column_stack([points, intensity]) if coloured else points, next(masks)
        yield pose, cloud if mask is None else cloud[mask]


def _about_inputs(prepared: Prepared) -> list[str]:
    inputs, fronts = prepared.inputs, prepared.fronts
    sentences = [s for robot in inputs.robots for s in remarks(robot, fronts[robot.robot], prepared.config)]
    sentences += prepared.grounding.sentences
    if prepared.from_cache:
        sentences.append(
            f"odometry of {', '.join(prepared.from_cache)} was taken from the cache; its seconds are those it took then"
        )
    return sentences
