"""What is to be compared: configurations, filters, and the worlds in which they run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from wiclosure.errors import ConfigError
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.pipeline.data.scenarios.scenario_source import scenario_inputs
from wiclosure.simulation.names import lookup
from wiclosure.simulation.scenarios.registry import ScenarioSettings
from wiclosure.wiclosure_filter.registry import FILTERS


@dataclass(frozen=True, eq=False)
class World:
    """Recordings that all arms run over.

    Args:
        seed: what tells it from other worlds.
        inputs: opens them.
        draws: seeds of the random filter, which runs once with each.
    """

    seed: int
    inputs: Callable[[], Inputs]
    draws: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Plan:
    """What is to be compared.

    Args:
        configs: configuration by the name of its preset.
        filters: names, the first being the base that the others are compared with.
        worlds: where they run.
        remarks: sentences for the user.
    """

    configs: Mapping[str, Config]
    filters: tuple[str, ...]
    worlds: tuple[World, ...]
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.filters:
            raise ConfigError("there is nothing to compare; name filters, for example --filters none,wiclosure")
        for name in self.filters:
            lookup("candidate filter", name, FILTERS)
        require_each_once("filter", self.filters)

    def folder(self, seed: int, preset: str) -> Path:
        """Where the arms of one seed and preset lie, below the result folder."""
        several_seeds = len({draw for world in self.worlds for draw in world.draws}) > 1
        levels = [f"seed-{seed}"] if several_seeds else []
        return Path(*levels, *([preset] if len(self.configs) > 1 else []))


def recorded_worlds(
    inputs: Callable[[], Inputs], filters: Sequence[str], seeds: int = 1, first_seed: int = 0
) -> tuple[tuple[World, ...], tuple[str, ...]]:
    """Recordings as the one world that they are, with a remark where more seeds than one are wanted.

    Args:
        inputs: opens them.
        filters: names; only `random` is another with each seed.
        seeds: draws of the random filter.
        first_seed: of the first draw.
    """
    draws = tuple(range(first_seed, first_seed + seeds)) if "random" in filters else (first_seed,)
    what = "so the other filters run once" if len(draws) > 1 else "and that is not among the filters: one run each"
    remark = f"recordings are one world: of {seeds} seeds only the random filter is another each time, {what}"
    return (World(first_seed, inputs, draws),), (remark,) if seeds > 1 else ()


def scenario_worlds(name: str, settings: ScenarioSettings, seeds: int, limit: int | None = None) -> tuple[World, ...]:
    """The scenario with its seed and those that follow.

    Args:
        name: of the scenario.
        settings: of the first world.
        seeds: how many worlds.
        limit: read at most so many scans of each robot.
    """
    return tuple(
        World(seed, partial(scenario_inputs, name, settings.model_copy(update={"seed": seed}), limit=limit), (seed,))
        for seed in range(settings.seed, settings.seed + seeds)
    )


def require_each_once(what: str, names: Sequence[str]) -> None:
    """Fails where a name occurs twice.

    Raises:
        ConfigError: it does.
    """
    twice = sorted({name for name in names if list(names).count(name) > 1})
    if twice:
        raise ConfigError(f"{what} {', '.join(twice)} is named twice; name each once")
