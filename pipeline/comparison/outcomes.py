"""What the arms of a comparison leave behind."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from wiclosure.pipeline.comparison.plan import Plan
from wiclosure.pipeline.evaluation.metrics import Metrics


@dataclass(frozen=True, eq=False)
class Outcome:
    """What stays of an arm's run over one world.

    Args:
        seed: of the world, or of the random filter where only that changes.
        preset: name.
        filter: name.
        folder: of the run, below the result folder.
        metrics: its figures.
    """

    seed: int
    preset: str
    filter: str
    folder: Path
    metrics: Metrics


@dataclass(frozen=True, eq=False)
class Comparison:
    """All outcomes, in the order of presets, filters, seeds."""

    plan: Plan
    outcomes: tuple[Outcome, ...]

    @property
    def arms(self) -> dict[tuple[str, str], tuple[Outcome, ...]]:
        """Outcomes by preset and filter."""
        names = [(preset, name) for preset in self.plan.configs for name in self.plan.filters]
        return {arm: tuple(o for o in self.outcomes if (o.preset, o.filter) == arm) for arm in names}

    def base(self, preset: str) -> tuple[Outcome, ...]:
        """Outcomes of the arm that the others of the preset are compared with."""
        return self.arms[preset, self.plan.filters[0]]
