"""A/B: the same recordings with different filters, over shared odometry, descriptors and registrations."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from wiclosure.errors import ConfigError
from wiclosure.interfaces import CandidateFilter
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.inputs import Inputs
from wiclosure.pipeline.metrics import Metrics
from wiclosure.pipeline.progress import Progress
from wiclosure.pipeline.run import Prepared, RunResult, candidate_filter, run
from wiclosure.pipeline.run_folder import write_json, write_run
from wiclosure.pipeline.tables import comparison_markdown

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Comparison:
    """The runs of all arms, by filter, the first being the base."""

    arms: dict[str, RunResult]

    @property
    def metrics(self) -> dict[str, Metrics]:
        """Figures of each arm."""
        return {name: result.metrics for name, result in self.arms.items()}


def filters_named(filters: Sequence[str], inputs: Inputs, config: Config) -> list[CandidateFilter]:
    """The filters to compare.

    Raises:
        ConfigError: no filter, one named twice, or an unknown one.
    """
    if not filters:
        raise ConfigError("there is nothing to compare; name filters, for example --filters none,wiclosure")
    twice = {name for name in filters if list(filters).count(name) > 1}
    if twice:
        raise ConfigError(f"filter {', '.join(sorted(twice))} is named twice; name each once")
    return [candidate_filter(name, inputs, config) for name in filters]


def compare(prepared: Prepared, filters: Sequence[CandidateFilter], *, progress: Progress) -> Comparison:
    """Runs every filter.

    Stage times are what each arm costs alone: a registration that two arms need is done once and charged to both.
    Memory is that of the process so far, so that it only says something of the first arm; the others have none.
    """
    arms = {chosen.name: run(prepared, chosen, progress=progress) for chosen in filters}
    for result in list(arms.values())[1:]:
        result.metrics["peak_rss_mb"] = None
    return Comparison(arms)


def write_comparison(folder: Path, comparison: Comparison) -> None:
    """One run folder an arm, and `comparison.json` and `comparison.md` beside them."""
    for name, result in comparison.arms.items():
        (folder / name).mkdir()
        write_run(folder / name, result)
    write_json(folder / "comparison.json", comparison.metrics)
    (folder / "comparison.md").write_text(comparison_markdown(comparison.metrics), encoding="utf-8")
