"""What the words of the command line ask to compare."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from wiclosure.errors import ConfigError
from wiclosure.pipeline.cli.options import Configuration, Reading
from wiclosure.pipeline.comparison.arms import Plan, World, require_each_once
from wiclosure.pipeline.data.scenario_source import PREFIX, read_scenario_word, scenario_inputs
from wiclosure.simulation.scenarios import ScenarioSettings


def make_plan(
    data: Sequence[str],
    filters: str,
    presets: str | None = None,
    seeds: int = 1,
    *,
    configuration: Configuration,
    reading: Reading,
) -> Plan:
    """Arms and worlds, checked before any work.

    Args:
        data: words that name recordings, or one scenario.
        filters: comma-separated names.
        presets: comma-separated presets or YAML files; None: the configuration alone.
        seeds: worlds of a scenario, or draws of the random filter over recordings.
        configuration: what the presets are laid over.
        reading: how recordings are read.

    Raises:
        ConfigError: an unknown filter or preset (with the nearest name), one named twice, or none.
    """
    sources: Sequence[str | None] = _words(presets or "") or [None]
    names = [Path(source or configuration.config or "default").stem for source in sources]
    require_each_once("preset", names)
    configs = {name: configuration.resolved(preset=source) for name, source in zip(names, sources, strict=True)}
    chosen = tuple(_words(filters))
    if not any(word.startswith(PREFIX) for word in data):
        return Plan(configs, chosen, *_recorded(data, chosen, seeds, configuration.seed or 0, reading))
    if configuration.seed is not None:
        raise ConfigError("--seed: the seed of a scenario is named with it, for example scenario:city,seed=3")
    reading.inputs(data)  # refuses what cannot be read beside a scenario
    name, settings = read_scenario_word(data[0])
    return Plan(configs, chosen, scenario_worlds(name, settings, seeds, reading.n_scans))


def _recorded(
    data: Sequence[str], filters: Sequence[str], seeds: int, first_draw: int, reading: Reading
) -> tuple[tuple[World, ...], tuple[str, ...]]:
    draws = tuple(range(first_draw, first_draw + seeds)) if "random" in filters else (first_draw,)
    what = "so the other filters run once" if len(draws) > 1 else "and that is not among the filters: one run each"
    remark = f"recordings are one world: of {seeds} seeds only the random filter is another each time, {what}"
    return (World(first_draw, partial(reading.inputs, data), draws),), (remark,) if seeds > 1 else ()


def scenario_worlds(name: str, settings: ScenarioSettings, seeds: int, limit: int | None = None) -> tuple[World, ...]:
    """The scenario with its seed and those that follow."""
    return tuple(
        World(seed, partial(scenario_inputs, name, settings.model_copy(update={"seed": seed}), limit=limit), (seed,))
        for seed in range(settings.seed, settings.seed + seeds)
    )


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
