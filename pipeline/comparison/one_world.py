"""All arms of one world, presets x filters, one after the other over shared stages.

Odometry and descriptors are shared by presets with equal front ends, registrations by arms with equal registration;
what an arm leaves behind is written at once, and only its figures stay in memory.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from wiclosure.errors import WiclosureError
from wiclosure.pipeline.comparison.outcomes import Outcome
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

Viewed: TypeAlias = Callable[[str], AbstractContextManager[Viewer]]
"""Gives the viewer of the run of that name."""


def unseen(_: str) -> AbstractContextManager[Viewer]:
    """Nobody looks at any run."""
    return nullcontext(NoViewer())


@dataclass(frozen=True, eq=False)
class Arms:
    """What is run in one world, where it goes, and who looks.

    Args:
        world: the recordings.
        plan: of the comparison.
        folder: each arm's run folder goes below it.
        cache: stages of earlier runs.
        viewed: gives the viewer of an arm.
        cached: by the number of a group of presets with equal front ends, robots whose odometry an earlier invocation
            computed, where this one has computed that of the others already.
    """

    world: World
    plan: Plan
    folder: Path
    cache: StageCache
    viewed: Viewed = unseen
    cached: Mapping[int, tuple[str, ...]] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"the comparison with seed {self.world.seed}"

    def run(self, *, jobs: int, progress: Progress, cluster: Workers | None = None) -> Iterator[Outcome]:
        """Each arm's outcome, when its run folder is written.

        Raises:
            ConfigError: an arm that cannot run on these recordings; said before the work.
        """
        with _named(f"seed {self.world.seed}" if len(self.plan.worlds) > 1 else ""):
            inputs = self.world.inputs()
            for config in self.plan.configs.values():
                for name in self.plan.filters:
                    candidate_filter(name, inputs, config)
            groups = with_equal_front_ends(self.plan.configs)
            for number, (configs, (first, *later)) in enumerate(zip(groups, first_and_later(groups), strict=True)):
                shared = prepare(
                    inputs, first, cache=self.cache, jobs=jobs, progress=progress, also=later, cluster=cluster
                )
                shared = replace(shared, from_cache=self.cached.get(number, shared.from_cache))
                known: dict[object, KnownRegistrations] = {}
                for preset, config in configs.items():
                    prepared = replace(shared, config=config, known=known.setdefault(config.registration, {}))
                    yield from self._filters(prepared, preset, progress)
                    shared = replace(shared, shared=True)

    def _filters(self, prepared: Prepared, preset: str, progress: Progress) -> Iterator[Outcome]:
        """All filters with one preset; `random` last, since it keeps as many pairs as `wiclosure` did."""
        sketches: dict[str, Sketch] = {}
        keep_rate = prepared.config.filter.random.keep_rate
        for name in sorted(self.plan.filters, key=lambda name: name == "random"):
            for seed in self.world.draws if name == "random" else (self.world.seed,):
                own = replace(prepared, config=_with_random(prepared.config, keep_rate, seed))
                outcome, sketch = self._arm(own, Path(self.plan.folder(seed, preset), name), seed, preset, progress)
                sketches.setdefault(name, sketch)
                prepared = replace(prepared, shared=True)
                if name == "wiclosure" and outcome.metrics["pairs_total"]:
                    keep_rate = outcome.metrics["pairs_kept"] / outcome.metrics["pairs_total"]
                yield outcome
        together = self.folder / self.plan.folder(self.world.seed, preset)
        illustrate_arms(together, {name: sketches[name] for name in self.plan.filters})

    def _arm(
        self, prepared: Prepared, where: Path, seed: int, preset: str, progress: Progress
    ) -> tuple[Outcome, Sketch]:
        workers = prepared.cluster or local_workers(prepared.jobs)
        chosen = candidate_filter(where.name, prepared.inputs, prepared.config, workers)
        several = len(self.plan.configs) > 1
        with _named(f"{preset}, {where.name}" if several else where.name), self.viewed("-".join(where.parts)) as viewer:
            result = run_stages(prepared, chosen, progress=progress, viewer=viewer)
        if prepared.shared or self.world is not self.plan.worlds[0] or preset != next(iter(self.plan.configs)):
            result.metrics["peak_rss_mb"] = None
        folder = self.folder / where
        shutil.rmtree(folder, ignore_errors=True)  # a worker that was killed may have begun it
        folder.mkdir(parents=True)
        write_run(folder, result)
        illustrate_run(folder, result)
        write_run_report(folder, result)
        return Outcome(seed, preset, where.name, where, result.metrics), Sketch.of(result)


def with_equal_front_ends(configs: Mapping[str, Config]) -> list[dict[str, Config]]:
    """Presets that can share odometry, keyframes and descriptors, together."""
    groups: dict[object, dict[str, Config]] = {}
    for preset, config in configs.items():
        key = (config.odometry, config.keyframes, config.scan_context, config.drift)
        groups.setdefault(key, {})[preset] = config
    return list(groups.values())


def first_and_later(groups: Sequence[Mapping[str, Config]]) -> list[list[Config]]:
    """For each group a configuration that stands for it, and those of the groups behind."""
    firsts = [next(iter(configs.values())) for configs in groups]
    return [firsts[number:] for number in range(len(firsts))]


def _with_random(config: Config, keep_rate: float, seed: int) -> Config:
    random = config.filter.random.model_copy(update={"keep_rate": keep_rate, "seed": seed})
    return config.model_copy(update={"filter": config.filter.model_copy(update={"random": random})})


@contextmanager
def _named(what: str) -> Iterator[None]:
    """Whatever the user can act on says in which run it was."""
    try:
        yield
    except WiclosureError as error:
        if not what:
            raise
        raise type(error)(f"{what}: {error}") from error
