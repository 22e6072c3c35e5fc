"""Arms of a comparison, presets x filters x seeds, run one after the other over shared stages.

Odometry and descriptors are shared by presets with equal front ends, registrations by arms with equal registration;
what an arm leaves behind is written at once, and only its figures stay in memory.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.plan import Plan, World
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.report.html.report import write_run_report
from wiclosure.pipeline.report.illustrations import Sketch, illustrate_arms, illustrate_run
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.stages.registrations import KnownRegistrations
from wiclosure.pipeline.stages.run import Prepared, candidate_filter, prepare, run_stages
from wiclosure.pipeline.stages.run_folder import write_run

logger = logging.getLogger(__name__)


def compare(plan: Plan, folder: Path, *, cache: StageCache, jobs: int, progress: Progress) -> Comparison:
    """Runs every arm, and writes each one's run folder and pictures below `folder`.

    Memory is that of the process so far, so that it only says something of the first arm; the others have none.

    Raises:
        ConfigError: an arm that cannot run on these recordings.
    """
    outcomes: list[Outcome] = []
    for world in plan.worlds:
        outcomes += _compare_in(world, plan, folder, cache=cache, jobs=jobs, progress=progress)
    presets = list(plan.configs)
    outcomes.sort(key=lambda o: (presets.index(o.preset), plan.filters.index(o.filter), o.seed))
    return Comparison(plan, tuple(outcomes))


def _compare_in(
    world: World, plan: Plan, folder: Path, *, cache: StageCache, jobs: int, progress: Progress
) -> Iterator[Outcome]:
    inputs = world.inputs()
    for config in plan.configs.values():
        for name in plan.filters:
            candidate_filter(name, inputs, config)  # whatever cannot run fails before the work
    groups = _with_equal_front_ends(plan.configs)
    firsts = [next(iter(configs.values())) for configs in groups]
    for number, configs in enumerate(groups):
        later = firsts[number + 1 :]
        shared = prepare(inputs, firsts[number], cache=cache, jobs=jobs, progress=progress, also=later)
        known: dict[object, KnownRegistrations] = {}
        for preset, config in configs.items():
            prepared = replace(shared, config=config, known=known.setdefault(config.registration, {}))
            yield from _compare_filters(prepared, preset, world, plan, folder, progress)
            shared = replace(shared, shared=True)


def _compare_filters(
    prepared: Prepared, preset: str, world: World, plan: Plan, folder: Path, progress: Progress
) -> Iterator[Outcome]:
    """All filters with one preset; `random` last, since it keeps as many pairs as `wiclosure` did."""
    sketches: dict[str, Sketch] = {}
    keep_rate = prepared.config.filter.random.keep_rate
    for name in sorted(plan.filters, key=lambda name: name == "random"):
        for seed in world.draws if name == "random" else (world.seed,):
            own = replace(prepared, config=_with_random(prepared.config, keep_rate, seed))
            result = run_stages(own, candidate_filter(name, own.inputs, own.config), progress=progress)
            if sketches or world is not plan.worlds[0] or preset != next(iter(plan.configs)):
                result.metrics["peak_rss_mb"] = None
            where = plan.folder(seed, preset) / name
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
