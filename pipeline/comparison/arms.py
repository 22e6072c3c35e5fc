"""Arms of a comparison, presets x filters x seeds, run one after the other over shared stages.

Odometry and descriptors are shared by presets with equal front ends, registrations by arms with equal registration;
what an arm leaves behind is written at once, and only its figures stay in memory.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.plan import Plan, World
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.report.html.report import write_run_report
from wiclosure.pipeline.report.illustrations import Sketch, illustrate_arms, illustrate_run
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.processes import local_workers
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.stages.registrations import KnownRegistrations
from wiclosure.pipeline.stages.run import Prepared, candidate_filter, prepare, run_stages
from wiclosure.pipeline.stages.run_folder import write_run
from wiclosure.pipeline.stages.viewer import NoViewer, Viewer
from wiclosure.workers import Workers

logger = logging.getLogger(__name__)


Viewed: TypeAlias = Callable[[str], AbstractContextManager[Viewer]]
"""Gives the viewer of the run of that name."""


def compare(
    plan: Plan,
    folder: Path,
    *,
    cache: StageCache,
    jobs: int,
    progress: Progress,
    viewed: Viewed | None = None,
    cluster: Workers | None = None,
) -> Comparison:
    """Runs every arm, and writes each one's run folder and pictures below `folder`.

    Memory is that of the process so far, so that it only says something of the first arm; the others have none.

    Raises:
        ConfigError: an arm that cannot run on these recordings.
    """
    outcomes: list[Outcome] = []
    for world in plan.worlds:
        arms = _Arms(world, plan, folder, progress, viewed or _unseen)
        outcomes += _compare_in(arms, cache=cache, jobs=jobs, cluster=cluster)
    presets = list(plan.configs)
    outcomes.sort(key=lambda o: (presets.index(o.preset), plan.filters.index(o.filter), o.seed))
    return Comparison(plan, tuple(outcomes))


@dataclass(frozen=True, eq=False)
class _Arms:
    """What is run in one world, where it goes, and who looks."""

    world: World
    plan: Plan
    folder: Path
    progress: Progress
    viewed: Viewed


def _unseen(_: str) -> AbstractContextManager[Viewer]:
    return nullcontext(NoViewer())


def _compare_in(arms: _Arms, *, cache: StageCache, jobs: int, cluster: Workers | None) -> Iterator[Outcome]:
    plan, inputs = arms.plan, arms.world.inputs()
    for config in plan.configs.values():
        for name in plan.filters:
            candidate_filter(name, inputs, config)  # whatever cannot run fails before the work
    groups = _with_equal_front_ends(plan.configs)
    firsts = [next(iter(configs.values())) for configs in groups]
    for number, configs in enumerate(groups):
        later = firsts[number + 1 :]
        shared = prepare(
            inputs, firsts[number], cache=cache, jobs=jobs, progress=arms.progress, also=later, cluster=cluster
        )
        known: dict[object, KnownRegistrations] = {}
        for preset, config in configs.items():
            prepared = replace(shared, config=config, known=known.setdefault(config.registration, {}))
            yield from _compare_filters(prepared, preset, arms)
            shared = replace(shared, shared=True)


def _compare_filters(prepared: Prepared, preset: str, arms: _Arms) -> Iterator[Outcome]:
    """All filters with one preset; `random` last, since it keeps as many pairs as `wiclosure` did."""
    world, plan, folder = arms.world, arms.plan, arms.folder
    sketches: dict[str, Sketch] = {}
    keep_rate = prepared.config.filter.random.keep_rate
    for name in sorted(plan.filters, key=lambda name: name == "random"):
        for seed in world.draws if name == "random" else (world.seed,):
            own = replace(prepared, config=_with_random(prepared.config, keep_rate, seed))
            workers = own.cluster or local_workers(own.jobs)
            chosen = candidate_filter(name, own.inputs, own.config, workers)
            where = plan.folder(seed, preset) / name
            with arms.viewed("-".join(where.parts)) as viewer:
                result = run_stages(own, chosen, progress=arms.progress, viewer=viewer)
            if sketches or world is not plan.worlds[0] or preset != next(iter(plan.configs)):
                result.metrics["peak_rss_mb"] = None
            (folder / where).mkdir(parents=True)
            write_run(folder / where, result)
            illustrate_run(folder / where, result)
            write_run_report(folder / where, result)
            sketches.setdefault(name, Sketch.of(result))
            prepared = replace(prepared, shared=True)
            if name == "wiclosure" and result.metrics["pairs_total"]:
                keep_rate = result.metrics["pairs_kept"] / result.metrics["pairs_total"]
            yield Outcome(seed, preset, name, where, result.metrics)
    illustrate_arms(folder / plan.folder(world.seed, preset), {name: sketches[name] for name in plan.filters})


def _with_random(config: Config, keep_rate: float, seed: int) -> Config:
    random = config.filter.random.model_copy(update={"keep_rate": keep_rate, "seed": seed})
    return config.model_copy(update={"filter": config.filter.model_copy(update={"random": random})})


def _with_equal_front_ends(configs: Mapping[str, Config]) -> list[dict[str, Config]]:
    """Presets that can share odometry, keyframes and descriptors, together."""
    groups: dict[object, dict[str, Config]] = {}
    for preset, config in configs.items():
        key = (config.odometry, config.keyframes, config.scan_context, config.drift)
        groups.setdefault(key, {})[preset] = config
    return list(groups.values())
