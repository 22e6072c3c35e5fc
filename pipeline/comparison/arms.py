"""Arms of a comparison, presets x filters x seeds: worlds side by side, the arms of each one after the other.

Arms of one world reuse each other's odometry and registrations, so that one worker does them all.  Worlds that are
too few to occupy all workers come last, one after the other with the stages of each side by side, once the odometry
of all of them is done.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from wiclosure.errors import ConfigError
from wiclosure.pipeline.comparison.one_world import Arms, Viewed, first_and_later, unseen, with_equal_front_ends
from wiclosure.pipeline.comparison.outcomes import Comparison, Outcome
from wiclosure.pipeline.comparison.plan import Plan
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.log import collected, logged_again
from wiclosure.pipeline.runtime.processes import local_workers
from wiclosure.pipeline.runtime.progress import Progress
from wiclosure.pipeline.stages.odometry import odometry_into_cache
from wiclosure.workers import Workers, tell

_Item = TypeVar("_Item")


def compare(
    plan: Plan,
    folder: Path,
    *,
    cache: StageCache,
    jobs: int,
    progress: Progress,
    viewed: Viewed | None = None,
    apart: bool = True,
    cluster: Workers | None = None,
) -> Comparison:
    """Runs every arm, and writes each one's run folder and pictures below `folder`.

    Memory is that of the process so far, so that it only says something of the first arm; the others have none.

    Args:
        plan: what is compared.
        folder: must be seen by the workers of a cluster under the same path, where there are several worlds.
        cache: stages of earlier runs, and what workers hand over.
        jobs: processes.
        progress: shows how far it is.
        viewed: gives the viewer of the run of that name.
        apart: whether a viewer may look from another process.
        cluster: does the work in place of processes here.

    Raises:
        ConfigError: an arm that cannot run on these recordings.
    """
    every = [Arms(world, plan, folder, cache, viewed or unseen) for world in plan.worlds]
    workers = cluster or local_workers(jobs)
    full = len(every) // workers.count * workers.count if apart and workers.count > 1 else 0
    outcomes = _side_by_side(every[:full], workers, progress) if full else []
    left = every[full:]
    if len(left) > 1 and workers.count > 1 and cache.folder is not None:
        left = _with_odometry(left, workers, progress)
    for arms in left:
        outcomes += arms.run(jobs=jobs, progress=progress, cluster=cluster)
    presets = list(plan.configs)
    outcomes.sort(key=lambda o: (presets.index(o.preset), plan.filters.index(o.filter), o.seed))
    return Comparison(plan, tuple(outcomes))


def _side_by_side(every: Sequence[Arms], workers: Workers, progress: Progress) -> list[Outcome]:
    """One worker for all arms of a world, with a bar for each world."""
    with (
        progress.together({str(arms.world.seed): 100 for arms in every}, "percent of seed") as counted,
        closing(workers.each(_all_arms, every, told=counted)) as done,
    ):
        outcomes: list[Outcome] = []
        for _, (found, records) in done:
            outcomes += found
            logged_again(records)
    return outcomes


def _all_arms(arms: Arms) -> tuple[list[Outcome], list[logging.LogRecord]]:
    """What a worker does: the outcomes of a world, and what was logged."""
    if not arms.folder.is_dir():
        raise ConfigError(f"a worker does not see {arms.folder}: all workers must share the folder of --out")
    plan = arms.plan
    draws = len(arms.world.draws) if "random" in plan.filters else 1
    runs = len(plan.configs) * (len(plan.filters) - 1 + draws)
    share = _Share(str(arms.world.seed), len(with_equal_front_ends(plan.configs)) + runs)
    outcomes: list[Outcome] = []
    with collected() as records:
        for outcome in arms.run(jobs=1, progress=share):
            outcomes.append(outcome)
            share.step()
    return outcomes, records


def _with_odometry(left: Sequence[Arms], workers: Workers, progress: Progress) -> list[Arms]:
    """The same worlds, when the cache holds the odometry of all their robots."""
    cache, cached = left[0].cache, [dict[int, tuple[str, ...]]() for _ in left]
    for number, configs in enumerate(first_and_later(with_equal_front_ends(left[0].plan.configs))):
        robots = {
            (n, robot.robot, f"{robot.robot}, seed {arms.world.seed}"): robot
            for n, arms in enumerate(left)
            for robot in arms.world.inputs().robots
        }
        reused = odometry_into_cache(
            {name: robot for (_, _, name), robot in robots.items()}, configs, cache, workers, progress
        )
        for n in range(len(left)):
            cached[n][number] = tuple(robot for of, robot, name in robots if of == n and name in reused)
    return [replace(arms, cached=known) for arms, known in zip(left, cached, strict=True)]


class _Share:
    """Progress of a world, told as percent of all its steps: odometry, and each arm."""

    def __init__(self, name: str, steps: int) -> None:
        self._name, self._steps, self._finished, self._told = name, steps, 0, 0

    def track(self, items: Iterable[_Item], label: str, total: int | None = None) -> Iterator[_Item]:
        """The same items; those of one step."""
        for done, item in enumerate(items, start=1):
            yield item
            self._tell(done / (total or done))

    @contextmanager
    def together(self, totals: Mapping[str, int], label: str) -> Iterator[Callable[[str, int], None]]:
        """All of them are one step."""
        counts = dict.fromkeys(totals, 0)

        def counted(name: str, done: int) -> None:
            counts[name] = done
            self._tell(sum(counts.values()) / max(1, sum(totals.values())))

        yield counted
        self.step()

    def step(self) -> None:
        """One is finished."""
        self._finished += 1
        self._tell(0.0)

    def _tell(self, of_step: float) -> None:
        percent = int(100 * (self._finished + min(of_step, 1.0)) / self._steps)
        if percent > self._told:
            self._told = percent
            tell(self._name, percent)
